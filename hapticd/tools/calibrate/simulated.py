"""Simulated measurements for the steps that need no board: scan, touches and friction readings.

The pad lies as the rig's pad does; friction follows the scene's built-in curve. Left out: a rotated scan, fingers that
miss their mark, friction that drifts as a finger dries.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence

import numpy as np

from ...config.sections import SimConfig
from ...core.friction import DEFAULT_FRICTION_CURVE
from ...design import sample_scan
from ...formats.mode_map import Scan, SweptModes
from ...sim.fingers.paths import Rest, Touch, Touches
from ...sim.fingers.sensor import Report, SensorModel, SensorSettings
from ...sim.plate.glasses import find_glass
from ...sim.plate.ground_truth import GroundTruth, PlateSettings
from ...sim.plate.shapes import theory
from ...values import FloatArray, TouchFrame
from ...wire.trackpad import DEFAULT_PAD, Decoder

SCAN_NOISE_FRAC, SCAN_MISSING_FRAC, SCAN_DROPOUT_FRAC = 0.02, 0.03, 0.01
DRIVE_PHASE_RAD, PHASE_STEP_RAD = 0.4, -0.15  # of the first mode's readings, by the electronics, and to the next mode's

HOLD_S, AWAY_S = 0.9, 0.5  # time of a finger on a mark, and between two marks
TREMOR_MM = 0.05

BARE_FRICTION, FLOOR_FRICTION = 0.8, 0.25  # coefficients of a dry finger on glass, still and levitated
FRICTION_NOISE = 0.02
REPEATS = 5  # readings at each amplitude
SLIPS = 3  # readings in which the finger stuck


def source(options: argparse.Namespace) -> str:
    """Return what the pictures of a step say of their measurements."""
    return f"simulated, seed {options.seed}" if options.sim else ""


def scan(seed: int, plate: SimConfig, swept_hz: FloatArray | None = None) -> Scan:
    """Return complex readings of all modes near the drive, and what a sweep shows of them; or those of the modes that
    a sweep has at `swept_hz`, over what the sensors show of each."""
    truth = GroundTruth(PlateSettings.of(plate.plate, plate.modes or None, plate.wiring))
    glass = truth.settings.plate
    read, scale = np.arange(len(truth.frequency_hz)), np.ones(len(truth.frequency_hz))
    if swept_hz is not None:
        read = np.abs(truth.frequency_hz - swept_hz[:, None]).argmin(axis=1)
        scale = 1.0 / np.linalg.norm(truth.sensor, axis=0)[read]
    names = [find_glass(glass).modes[mode] for mode in read]
    phase_rad = DRIVE_PHASE_RAD + PHASE_STEP_RAD * np.arange(len(names))
    points_mm, readings = sample_scan(
        [theory(name, glass)[1] for name in names],
        noise_frac=SCAN_NOISE_FRAC,
        seed=seed,
        missing_frac=SCAN_MISSING_FRAC,
        dropout_frac=SCAN_DROPOUT_FRAC,
        scale=(scale * np.exp(1j * phase_rad)).tolist(),
    )
    if swept_hz is not None:
        return Scan(points_mm, readings)
    q_factor = math.pi * truth.frequency_hz / truth.decay_1_s
    return Scan(points_mm, readings, SweptModes(truth.frequency_hz, q_factor, truth.gain_um_per_v_s))


def touch_reports(
    marks_mm: Sequence[tuple[float, float]], seed: int, settings: SensorSettings | None = None
) -> list[Report]:
    """Return the pad's reports while one finger after the other rests on each mark."""
    touches = tuple(
        Touch(Rest(mark, TREMOR_MM, seed + place), place * (HOLD_S + AWAY_S), place * (HOLD_S + AWAY_S) + HOLD_S)
        for place, mark in enumerate(marks_mm)
    )
    return SensorModel(settings or SensorSettings(), seed).reports(
        [Touches(touches)], len(marks_mm) * (HOLD_S + AWAY_S)
    )


def frames(reports: Sequence[Report]) -> Iterator[TouchFrame]:
    """Yield what the simulated pad's reports show."""
    decoder = Decoder(DEFAULT_PAD)
    for report in reports:
        yield from decoder.decode(report.data, round(report.t_arrive_s * 1e9))


def friction_readings(seed: int) -> tuple[FloatArray, FloatArray]:
    """Return amplitudes in um and coefficients of friction (N,), some of them wrong."""
    random = np.random.default_rng(seed)
    amplitude_um = np.repeat(np.linspace(0.0, 3.0, 25), REPEATS)
    floor = DEFAULT_FRICTION_CURVE.floor_frac
    share = (DEFAULT_FRICTION_CURVE.frictions(amplitude_um, np.zeros(1)) - floor) / (1.0 - floor)
    friction = FLOOR_FRICTION + (BARE_FRICTION - FLOOR_FRICTION) * share
    friction += FRICTION_NOISE * random.standard_normal(len(friction))
    friction[random.choice(len(friction), SLIPS, replace=False)] += 0.3
    return amplitude_um, friction
