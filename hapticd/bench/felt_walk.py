"""The felt rule over many consecutive calls: do its weights drift, does a limit break, does a number overflow?

Laps of two kinds take turns, on two to eight modes. In a rough lap one to five contacts move at random, lie on top of
each other or over the plate's edge, land and lift, with targets from 0 to far beyond reach, flat and steep friction
curves, and places known exactly, hardly or not at all. In a calm lap two contacts follow the same closed way; what they
feel there must not depend on what came before.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ..core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..core.plate.mode_shapes import ModeShapes
from ..core.solver.felt import felt_points
from ..core.solver.felt_descent import MOST_WEIGHT, contact_shapes
from ..core.solver.instant import LEAST_STEP_UM, SLEW_UM_NS, InstantSolver, Place
from ..sim.plate.glasses import WIDE
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM
from ..values import WEBER_FRAC
from .stability import LAP, closed_way_mm
from .tables import Table, finite_rows
from .timing import no_garbage_collection

MODES = range(2, 9)
SINCE_NS = 2_000_000  # a frame's knots
ROUGH = 250  # calls until contacts, targets and what is known of them change
TARGETS_UM = (0.0, 0.0, 1e-9, 0.05, 0.3, 0.7, 1.0, 1.0, 2.0, 1e3)
CURVES = (
    DEFAULT_FRICTION_CURVE,
    FrictionCurve.from_amplitudes((0.0, 0.02, 0.05, 3.0), 0.01),  # steep, then flat
    FrictionCurve.from_amplitudes((0.0, 1.9, 2.0), 0.9),  # flat, then steep
)
VARIANCES_MM2 = (0.0, 0.04, 1e6, math.inf, math.nan)

Call = tuple[list[Place], list[float], list[float]]  # places, variances, stretches


def run(steps: int) -> Table:
    """Walk on two to eight modes; `steps` calls in all."""
    plate = GroundTruth(PlateSettings.of(WIDE))
    rows = [(f"{modes} modes", _walked(plate, modes, steps // len(MODES))) for modes in MODES]
    return Table(
        name="felt_walk",
        title=f"stability: friction as asked, on the {WIDE} plate, a rough lap and a calm one in turn",
        default=f"{MODES[0]} modes",
        rows=finite_rows(rows),
        compared=(),
        notes=(
            "failures: calls whose amplitudes or weights are not finite, or whose weights leave their bounds",
            "limits broken: calls with a mode beyond its limit, to the last bit; past slew: too long a step",
            "error: of the worse contact, mean over the second calm lap; drift: by how much the last has more",
        ),
    )


def _walked(plate: GroundTruth, modes: int, steps: int) -> dict[str, float]:
    random, shapes = np.random.default_rng(modes), plate.true_mode_map(modes)
    limits_um = tuple(random.uniform(0.5, 1.5, modes) * plate.w_limit_um[0])
    calm, laps = _calm(), max(steps // (2 * LAP), 3)
    solvers = [_solver(shapes, limits_um, curve) for curve in CURVES]
    counts = {"failures_count": 0.0, "limits_broken_count": 0.0, "past_slew_count": 0.0}
    errors, modal_um, taken_ns = [], tuple([0j] * modes), 0
    with no_garbage_collection():
        for lap in range(laps):
            for solver, calls in ((solvers[lap % len(CURVES)], _rough(random)), (solvers[0], calm)):
                for places, variances_mm2, stretches in calls:
                    before_um, t_start_ns = modal_um, time.perf_counter_ns()
                    modal_um = tuple(
                        map(complex, solver.solve(places, before_um, SINCE_NS, variances_mm2, stretches).modal_um)
                    )
                    taken_ns += time.perf_counter_ns() - t_start_ns
                    _count(
                        counts,
                        solver,
                        before_um,
                        modal_um,
                        limits_um,
                        is_silent=max(place[2] for place in places) <= 0.0,
                    )
                    if calls is calm and lap in (1, laps - 1):
                        errors.append(_error_jnd(shapes, places, modal_um))
    second, last = np.array(errors).reshape(2, -1).mean(axis=1)
    return {
        "steps_count": 2 * laps * LAP,
        "time_us": taken_ns * 1e-3 / (2 * laps * LAP),
        **counts,
        "error_jnd": float(second),
        "drift_jnd": float(last - second),
    }


def _solver(shapes: ModeShapes, limits_um: tuple[float, ...], curve: FrictionCurve) -> InstantSolver:
    return InstantSolver(
        shapes,
        limits_um,
        derating_mm2_um2=0.0,
        phase_rotation=False,
        contact_radius_mm=CONTACT_RADIUS_MM,
        friction_curve=curve,
        feels=True,
    )


def _calm() -> list[Call]:
    way_mm = closed_way_mm().tolist()
    return [([(*first, 1.0), (*second, 0.0)], [0.04, 0.04], [1.0, 1.0]) for first, second in way_mm]


def _rough(random: np.random.Generator) -> Iterator[Call]:
    for _ in range(LAP // ROUGH):
        fingers = int(random.integers(1, 6))
        start_mm, way_mm = random.uniform(-115.0, 115.0, (fingers, 2)), random.uniform(-20.0, 20.0, (fingers, 2))
        if random.random() < 0.3:
            start_mm[-1], way_mm[-1] = start_mm[0], way_mm[0]
        targets_um = random.choice(TARGETS_UM, fingers).tolist()
        variances_mm2 = random.choice(VARIANCES_MM2, fingers).tolist()
        stretches = random.choice((1.0, 1.0, 1.7, 40.0), fingers).tolist()
        for share in np.linspace(0.0, 1.0, ROUGH).tolist():
            points_mm = (start_mm + share * way_mm).tolist()
            places = [(x_mm, y_mm, target_um) for (x_mm, y_mm), target_um in zip(points_mm, targets_um, strict=True)]
            yield places, variances_mm2, stretches


def _count(
    counts: dict[str, float],
    solver: InstantSolver,
    before_um: tuple[complex, ...],
    modal_um: tuple[complex, ...],
    limits_um: tuple[float, ...],
    *,
    is_silent: bool,
) -> None:
    logs = solver._log_weights
    is_sound = all(math.isfinite(w_um.real) and math.isfinite(w_um.imag) for w_um in modal_um)
    counts["failures_count"] += not (is_sound and all(abs(log) <= MOST_WEIGHT for log in logs))
    counts["limits_broken_count"] += any(
        abs(w_um) > limit_um for w_um, limit_um in zip(modal_um, limits_um, strict=True)
    )
    step_um = max(abs(w_um - was_um) for w_um, was_um in zip(modal_um, before_um, strict=True))
    most_um = (LEAST_STEP_UM + SLEW_UM_NS * SINCE_NS) * (1.0 + 1e-12)
    counts["past_slew_count"] += step_um > most_um and not is_silent  # what slips no more falls silent at once


def _error_jnd(shapes: ModeShapes, places: list[Place], modal_um: tuple[complex, ...]) -> float:
    disc, curve = felt_points(), DEFAULT_FRICTION_CURVE
    contacts = [(x_mm, y_mm, CONTACT_RADIUS_MM, 0.0, CONTACT_RADIUS_MM) for x_mm, y_mm, _ in places]
    phi: npt.NDArray[np.float64] = np.frombuffer(contact_shapes(shapes, disc, contacts)).reshape(
        len(places), len(disc), -1
    )
    frictions = curve.frictions(np.abs(phi @ np.array(modal_um)), np.zeros(1)).mean(axis=1)
    asked = np.array([curve.friction(target_um) for _, _, target_um in places])
    return float(np.abs((frictions / asked - 1.0) / WEBER_FRAC).max())
