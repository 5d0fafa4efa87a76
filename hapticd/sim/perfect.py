"""The bound of a simulated run: the same fingers under perfect knowledge, without the loop's delay."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.plate.contact import ContactEllipse
from ..core.solver.instant import InstantSolver
from ..daemon.settings import friction_curve, pipeline_settings
from .lockstep import TICK_NS, Run
from .plate.ground_truth import GroundTruth
from .score import Score, ellipses_mm, needed_gains, score
from .settings import scheme_config


class Perfect(NamedTuple):
    """The same fingers under perfect knowledge: arrays as of `Run`, at every fourth control tick or so."""

    t_s: npt.NDArray[np.float64]
    modal_um: npt.NDArray[np.complex128]
    truth_um: npt.NDArray[np.complex128]
    limited: npt.NDArray[np.bool_]
    score: Score


def perfect(played: Run, every: int = 4, progress: Callable[[float], None] = lambda _: None) -> Perfect:
    """Solve for true positions, contacts, shapes and friction, without the loop's delay, at each `every` ticks."""
    part = slice(None, None, every)
    plate = GroundTruth(played.settings.plate)
    curve = friction_curve(played.settings.config)
    settings = pipeline_settings(scheme_config(played.settings))
    solver = InstantSolver(
        plate.true_mode_map(),
        plate.w_limit_um,
        derates=False,
        contact_radius_mm=settings.contact_radius_mm,
        friction_curve=curve,
    )
    t_s, finger_mm, target_um = played.t_s[part], played.finger_true_mm[part], played.target_um[part]
    known_mm = ellipses_mm(played.fingertips, t_s)[..., (0, 0, 1), (0, 1, 1)]
    person = plate.settings.world.amplitude_gains
    needed = needed_gains(t_s, finger_mm, curve, person)
    asks_um = target_um
    if played.settings.friction_targets:
        needs_um = np.vectorize(lambda friction: curve.amplitude_um(curve.friction_frac(friction)))
        at_rest_um = needs_um(DEFAULT_FRICTION_CURVE.frictions(np.nan_to_num(target_um)))
        asks_um = np.where(np.isfinite(target_um), needed * at_rest_um, math.nan)
    modes = plate.settings.driven_modes
    plate_um = np.zeros((len(t_s), len(plate.decay_1_s)), dtype=np.complex128)
    limited = np.zeros(len(t_s), dtype=bool)
    previous_um: tuple[complex, ...] = (0.0,) * modes
    for index, (points_mm, targets_um) in enumerate(zip(finger_mm.tolist(), asks_um.tolist(), strict=True)):
        progress(index / len(t_s))
        places = [
            (x_mm, y_mm, asked_um)
            for (x_mm, y_mm), asked_um in zip(points_mm, targets_um, strict=True)
            if math.isfinite(asked_um)
        ]
        if places:
            counts = np.isfinite(target_um[index])
            ellipses: list[ContactEllipse | None] = [
                (xx_mm, xy_mm, yy_mm) for xx_mm, xy_mm, yy_mm in known_mm[index, counts].tolist()
            ]
            gains = needed[index, counts].tolist()
            solution = solver.solve(places, previous_um, every * TICK_NS, gains, None, ellipses)
            previous_um, limited[index] = solution.modal_um, solution.limited
            plate_um[index, :modes] = previous_um
    truth_um = np.einsum("tnp,tp->tn", plate.shapes(finger_mm), plate_um)
    judged = score(
        *(t_s, finger_mm, target_um, truth_um, plate_um, plate.shapes),
        reference_um=plate_um[:, :modes],
        limited=limited,
        every=1,
        curve=curve,
        fingertips=played.fingertips,
        gains=person,
        friction_targets=played.settings.friction_targets,
    )
    return Perfect(t_s, plate_um[:, :modes], truth_um, limited, judged)
