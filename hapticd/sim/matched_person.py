"""A simulated person's curve as `hapticd calibrate person` finds it on a rig: in the rig's own amplitudes.

One finger strokes the plate as hands do, at the friction of the reference. What telemetry says of its amplitude has all
that is wrong with map, sensors, pad and motion; the friction is the true one, as far as persons can tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from statistics import fmean
from typing import Final, cast

from hapticd_contract.states import Perceived

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.plate.mode_shapes import ModeShapes
from ..daemon.machine import Machine
from ..daemon.observer import Observer
from ..design.person import calibrated
from ..values import WEBER_FRAC
from . import lockstep
from .fingers.scenarios import LAND_S, SCENARIOS, Actor, strokes
from .observer import KINDS, REFERENCE, SimulatedObserver
from .score import SETTLE_S
from .settings import Measured, Settings, in_world, knowing_person

_OTHER_STROKES: Final = 2000
_SESSION: Final = 2


def matched_factor(settings: Settings, known: Measured, seed: int, seconds: float) -> float:
    """Return by which factor the person of a world seems to differ from the usual one: of no finger in particular."""
    world, amplitude_um = settings.plate.world, DEFAULT_FRICTION_CURVE.amplitude_um
    asked_um = amplitude_um(DEFAULT_FRICTION_CURVE.friction_frac(REFERENCE))
    at_match = knowing_person(settings, world.friction_factor)
    alike = replace(at_match.plate.world.skin, finger_ratio=1.0)
    at_match = in_world(at_match, replace(at_match.plate.world, skin=alike))
    felt_um: list[float] = []

    def observed(machine: Machine, _: ModeShapes) -> Observer:
        curve, t_first_ns = machine.scene.friction_curve, lockstep.T_START_NS + round(1e9 * (LAND_S + SETTLE_S))

        def put(kind: str, t_ns: int, *values: object) -> None:
            if kind == "pass" and t_ns > t_first_ns:
                perceived = cast("Mapping[int, Perceived]", values[-1])
                frictions = [one.felt_friction for one in perceived.values()]
                felt_um.extend(curve.amplitude_um(friction) for friction in frictions if friction is not None)

        return put

    def one_finger(seed: int, speed_mm_s: float) -> tuple[Actor, ...]:
        return strokes(seed + _OTHER_STROKES, speed_mm_s, (asked_um, 0.0))[:1]

    played = lockstep.run(
        replace(SCENARIOS["strokes"], build=one_finger),
        settings=replace(at_match, friction_targets=True, session=_SESSION),
        seed=seed,
        seconds=seconds,
        observer=observed,
        measured=known,
    )
    friction = REFERENCE * (1.0 + WEBER_FRAC * played.score.fingers[0].bias_jnd)
    observer = SimulatedObserver([*KINDS.values()][seed % len(KINDS)], seed)
    error = observer.curve.decay_um(0.0) / calibrated(observer.compare, REFERENCE).decay_um
    return -math.log(friction) * DEFAULT_FRICTION_CURVE.decay_um(0.0) / fmean(felt_um) * error
