"""Statistics of touches: those of the hand that the simulation plays are those of recorded ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from hapticd.bench.motions import sense
from hapticd.core.prediction.pad_memory import PadMemory
from hapticd.sim.fingers.pad_noise import FILTERED_NOISE
from hapticd.sim.fingers.paths import Path
from hapticd.sim.fingers.real_strokes import Hand, RealStrokes
from hapticd.tools.calibrate.prediction import errors_mm
from hapticd.tools.touches import Trace
from hapticd.values import FloatArray

PERIOD_S: Final = 0.008  # of the recordings
_HALF, _CORNER = 2, 6  # periods: a speed spans four, a corner's arms six each
_MOVES_MM_S, _RESTS_MM_S = 20.0, 10.0  # slower is at rest; a curvature is that of a finger that moves
_CORNER_COS, _ARM_MM = 0.5, 0.5
_QUANTILES = {"25": 0.25, "50": 0.5, "75": 0.75, "95": 0.95}
HARDEST_MM: Final = 0.58  # error 15 ms ahead on the harder half of the touches, and on others of the same pad
# The statistics of the touches that `HAND` was fitted to (all of them: 0.51 mm ahead).
APPLE: Final = {
    "speed_25_mm_s": 85.5,
    "speed_50_mm_s": 150.4,
    "speed_75_mm_s": 201.4,
    "speed_95_mm_s": 295.4,
    "rest_frac": 0.030,
    "along_mm_s2_50": 1287.0,
    "along_mm_s2_95": 3521.0,
    "across_mm_s2_50": 588.0,
    "across_mm_s2_95": 3243.0,
    "curvature_1_mm_50": 0.0304,
    "curvature_1_mm_95": 0.376,
    "corners_1_s": 2.00,
    "ahead_15ms_mm": HARDEST_MM,
}


def statistics(touches: Sequence[Trace]) -> dict[str, float]:
    """Return speeds (mm/s), accelerations along and across the way (mm/s^2), curvature (1/mm), share of time at rest,
    corners per second of more than 60 degrees within 0.1 s, and the default predictor's RMS error (mm) 15 ms ahead."""
    columns: list[tuple[FloatArray, ...]] = []
    corners, total_s = 0, 0.0
    for touch in touches:
        at_s = np.arange(touch.t_s[0], touch.t_s[-1], PERIOD_S)
        if len(at_s) <= 2 * _CORNER:
            continue
        points = np.stack([np.interp(at_s, touch.t_s, axis) for axis in touch.xy_mm.T], axis=-1)
        corners += _corners(points)
        total_s += len(at_s) * PERIOD_S
        columns.append(_motion(points))
    speed, along, across, curvature = (np.concatenate(column) for column in zip(*columns, strict=True))
    found = {f"speed_{name}_mm_s": float(np.quantile(speed, share)) for name, share in _QUANTILES.items()}
    found["rest_frac"] = float(np.mean(speed < _RESTS_MM_S))
    for name, values in (("along_mm_s2", along), ("across_mm_s2", across), ("curvature_1_mm", curvature)):
        found |= {f"{name}_{share}": float(np.quantile(values, _QUANTILES[share])) for share in ("50", "95")}
    found["corners_1_s"] = corners / total_s
    memory = PadMemory()
    found["ahead_15ms_mm"] = errors_mm(touches, lambda: memory)[0]
    return found


def _motion(points: FloatArray) -> tuple[FloatArray, ...]:
    """Return speed everywhere, and accelerations and curvature where the finger moves."""
    span_s = 2 * _HALF * PERIOD_S
    velocity = (points[2 * _HALF :] - points[: -2 * _HALF]) / span_s
    acceleration = (velocity[2 * _HALF :] - velocity[: -2 * _HALF]) / span_s
    middle = velocity[_HALF:-_HALF]
    speed = np.hypot(*middle.T)
    moves = speed > _MOVES_MM_S
    (vx, vy), (ax, ay), speed = middle[moves].T, acceleration[moves].T, speed[moves]
    across = np.abs(vx * ay - vy * ax) / speed
    return np.hypot(*velocity.T), np.abs(vx * ax + vy * ay) / speed, across, across / speed**2


def _corners(points: FloatArray) -> int:
    """Return how often the direction changes by more than 60 degrees."""
    before, after = points[_CORNER:-_CORNER] - points[: -2 * _CORNER], points[2 * _CORNER :] - points[_CORNER:-_CORNER]
    lengths = np.hypot(*before.T), np.hypot(*after.T)
    cosine = np.sum(before * after, axis=1) / np.maximum(lengths[0] * lengths[1], 1e-9)
    is_sharp = (cosine < _CORNER_COS) & (np.minimum(*lengths) > _ARM_MM)
    return int(np.sum(np.diff(is_sharp.astype(int), prepend=0) == 1))


def played(hand: Hand, seeds: Sequence[int], seconds: float) -> list[Trace]:
    """Return the touches of pairs of fingers with this hand, as a pad that filters reports them."""
    found = []
    for seed in seeds:
        first = RealStrokes(2 * seed, (-30.0, 0.0), hand=hand)
        second = RealStrokes(2 * seed + 1, (30.0, 0.0), avoid=first, hand=hand)
        found += [sensed(finger, finger.seed, seconds) for finger in (first, second)]
    return found


def sensed(finger: Path, seed: int, seconds: float) -> Trace:
    """Return a finger's touch as a pad that filters reports it."""
    touch = sense(finger, seconds, seed, noise=FILTERED_NOISE, period_s=PERIOD_S)
    return Trace(touch.sampled_s, np.array([(x_mm, y_mm) for _, x_mm, y_mm in touch.samples]))
