"""Ordinary touching in a simulated world, and what `hapticd calibrate touch` makes of it."""

from __future__ import annotations

import math
from dataclasses import replace

from ..board_values import BoardCalibration, ModeCalibration
from ..daemon.recorder import header_of
from ..design.touch.judge import Judged
from ..files.recording.kinds import record_of
from ..sim.fingers.scenarios import SCENARIOS
from ..sim.lockstep import T_START_NS, Simulation
from ..sim.plate.ground_truth import GroundTruth
from ..sim.settings import Measured, Settings
from ..tools.touch_correction import (
    calibration_of,
    contact_settings,
    has_sensors,
    known_better,
    mode_map,
    pad_settings,
)
from ..tools.touch_recording import COLLECTED, Collected, Touched, touched

TELEMETRY_HZ = 500
TOUCHING_S = 60.0
FREE, GUIDED = "strokes", "guided"  # scenarios to learn from
_OTHER_STROKES = 1000  # added to a seed: what is learned on some strokes is judged on others,
_SESSION = 1  # and in another session, with another posture


def measured(settings: Settings, seed: int) -> Measured:
    """Return what the scan and the sweep of a world gave, by which its daemon works."""
    plate = GroundTruth(settings.plate)
    rates = zip(
        *(plate.nominal_decay_1_s.tolist(), plate.nominal_detuning_rad_s.tolist()),
        *(plate.nominal_gain_um_per_v_s.tolist(), plate.drive.T.tolist(), plate.sense.tolist()),
        strict=True,
    )
    modes = []
    for mode, (decay_1_s, detuning_rad_s, gain_um_per_v_s, drive, sense) in enumerate(rates):
        frequency_hz = plate.settings.drive_hz + detuning_rad_s / (2.0 * math.pi)
        modes.append(
            ModeCalibration(
                mode,
                frequency_hz,
                q_factor=math.pi * frequency_hz / decay_1_s,
                gain_um_per_v_s=gain_um_per_v_s,
                loop_phase_rad=0.0,
                drive=tuple(drive),
                sense=tuple(complex(weight) for weight in sense),
            )
        )
    return Measured(plate.measured_mode_map(seed), BoardCalibration(tuple(modes)))


def touch(settings: Settings, before: Measured, seed: int, seconds: float, scenario: str = FREE) -> Touched:
    """Touch the plate in strokes other than those of `seed`, free or guided; return what the daemon would record."""
    config = settings.config
    observed = replace(
        settings, session=_SESSION, config=replace(config, record=replace(config.record, telemetry_hz=TELEMETRY_HZ))
    )
    actors = SCENARIOS[scenario].build(seed + _OTHER_STROKES, settings.speed_mm_s)
    simulation = Simulation(actors, observed, seed, before)
    machine = simulation.machine
    machine.parasitic_modes = simulation.world.plate.parasitic_modes(seed)
    header = header_of(machine, t_ns=T_START_NS, utc="", is_whole=True)
    collected = Collected()

    def put(kind: str, t_ns: int, *values: object) -> None:
        if kind in COLLECTED:
            collected.take(record_of(kind, 0, t_ns, values))

    machine.observer = put
    simulation.run(seconds)
    return touched(collected, header, "touching")


def corrected(settings: Settings, before: Measured, found: Touched, judged: Judged) -> tuple[Settings, Measured]:
    """Return settings and measurements with what is adopted."""
    contacts = contact_settings(found, judged)
    config = settings.config
    config = replace(
        config,
        solver=replace(config.solver, **contacts.get("solver", {})),
        trackpad=replace(config.trackpad, **contacts.get("trackpad", {})),
    )
    if judged.refusal:
        return replace(settings, config=config), before
    pad = pad_settings(found, judged.calibration)
    trackpad = replace(
        config.trackpad, matrix=tuple(pad["matrix"]), offset_mm=tuple(pad["offset_mm"]), latency_ms=pad["latency_ms"]
    )
    calibration = calibration_of(found, judged) if has_sensors(found) else before.calibration
    modes = before.modes if judged.waves is None else mode_map(before.modes, judged)
    known = replace(config.uncertainty, **known_better(found, judged))
    settled = replace(config, trackpad=trackpad, uncertainty=known)
    return replace(settings, config=settled), Measured(modes, calibration)
