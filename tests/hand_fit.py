"""Statistics of touches, and the fit of the simulated hand to them (`hapticd.sim.fingers.real_strokes`).

    python tests/hand_fit.py F.npz GROUP    prints the touches' statistics, the hand that fits, and its own

F.npz is a file of `hapticd bench prediction --traces`, GROUP the kind of its devices. The search is random around the
best hand so far: each parameter changes by a factor, and a change stays where the differences of the statistics become
less.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Final

import numpy as np

from hapticd.bench.motions import sense
from hapticd.bench.prediction_traces import DEFAULT, compared, load, rms_mm
from hapticd.sim.fingers.pad_noise import FILTERED_NOISE
from hapticd.sim.fingers.paths import Path
from hapticd.sim.fingers.real_strokes import HAND, Hand, RealStrokes
from hapticd.tools.touches import Trace
from hapticd.values import FloatArray

PERIOD_S: Final = 0.008  # of the recordings
_HALF, _CORNER = 2, 6  # periods: a speed spans four, a corner's arms six each
_MOVES_MM_S, _RESTS_MM_S = 20.0, 10.0  # slower is at rest; a curvature is that of a finger that moves
_CORNER_COS, _ARM_MM = 0.5, 0.5
_QUANTILES = {"25": 0.25, "50": 0.5, "75": 0.75, "95": 0.95}
_WEIGHTS: Final = {"rest_frac": 0.2, "corners_1_s": 3.0, "ahead_15ms_mm": 5.0} | {
    f"speed_{name}_mm_s": 5.0 for name in _QUANTILES
}  # else 1
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
_ROUNDS, _SECONDS, _STEP = 300, 20.0, 0.12
_ANGLES: Final = {"corner_least_deg": 170.0}  # bounds
_SHARES: Final = ("corner_frac", "rest_frac", "overlap_frac", "isochrony", "flat_frac")


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
    (predictors,) = compared(list(touches), group_of=lambda _: "all").values()
    found["ahead_15ms_mm"] = rms_mm(predictors[DEFAULT], 0)
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
    return Trace("simulated/hand", touch.sampled_s, np.array([(x_mm, y_mm) for _, x_mm, y_mm in touch.samples]))


def misfit(found: Mapping[str, float], wanted: Mapping[str, float]) -> float:
    """Return the weighted sum of squared relative differences."""
    return sum(_WEIGHTS.get(name, 1.0) * (found[name] / wanted[name] - 1.0) ** 2 for name in wanted)


def fit(wanted: Mapping[str, float], rounds: int = _ROUNDS, seeds: Sequence[int] = range(101, 105)) -> Hand:
    """Return the hand whose statistics differ least from those wanted."""
    random = np.random.default_rng(1)
    best, least = HAND, misfit(statistics(played(HAND, seeds, _SECONDS)), wanted)
    for _ in range(rounds):
        changes = np.exp(_STEP * random.standard_normal(len(best)) * (random.random(len(best)) < 0.5))
        hand = Hand(
            *(_bounded(name, value * change) for name, value, change in zip(Hand._fields, best, changes, strict=True))
        )
        error = misfit(statistics(played(hand, seeds, _SECONDS)), wanted)
        if error < least:
            best, least = hand, error
            print(f"{least:.4f}  {hand}", file=sys.stderr, flush=True)
    return best


def _bounded(name: str, value: float) -> float:
    most = _ANGLES.get(name, 1.0 if name in _SHARES else math.inf)
    return min(value, 0.5 if name == "overlap_frac" else most)


def main(path: str, group: str) -> None:
    """Fit, and print."""
    wanted = statistics([one for one in load(FilePath(path)) if one.group == group])
    print(f"touches  {_shown(wanted)}")
    hand = fit(wanted | {"ahead_15ms_mm": max(wanted["ahead_15ms_mm"], HARDEST_MM)})
    print(f"{hand}\nhand     {_shown(statistics(played(hand, range(1, 21), _SECONDS)))}")


def _shown(found: Mapping[str, float]) -> str:
    return "  ".join(f"{name} {value:.4g}" for name, value in found.items())


if __name__ == "__main__":
    main(*sys.argv[1:3])
