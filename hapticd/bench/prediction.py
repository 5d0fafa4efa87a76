"""Predictors: error on many motions, and the run time of an update and a prediction.

The error is the RMS distance between the prediction and the true position of the finger 15 ms after the sampling, on
the motions of `motions`, and of some on a pad whose firmware filters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ..core.prediction import Predictor
from ..sim.fingers.pad_noise import FILTERED_NOISE
from ..sim.fingers.paths import ReachPath
from ..values import FloatArray
from .baselines import PREDICTORS
from .motions import MOTIONS, REST_AFTER_REACH_S, MotionTouch, touch
from .tables import Table
from .timing import REPEATS, least_us

AHEAD_S = 0.015
FILTERED = ("strokes", "slide", "straight", "rest", "sine", "circle", "reach", "stop")

Make = Callable[[], Predictor]


def run(*, seeds: Sequence[int] = range(6), repeats: int = REPEATS) -> tuple[Table, ...]:
    """Compare all predictors on a touch of each motion and seed."""
    touches = {name: [touch(motion, seed) for seed in seeds] for name, motion in MOTIONS.items()}
    filtered = {name: [touch(MOTIONS[name], seed, noise=FILTERED_NOISE) for seed in seeds] for name in FILTERED}
    timed = touches["strokes"][0]
    calls = {name: (partial(predicted_mm, make, timed), len(timed.samples)) for name, make in PREDICTORS.items()}
    times_us = least_us(calls, repeats)
    rows, filtered_rows = {}, {}
    for name, make in PREDICTORS.items():
        errors_mm = {f"{motion}_mm": rms_mm(make, some) for motion, some in touches.items()}
        rows[name] = {"time_us": times_us[name]} | errors_mm | {"overshoot_mm": overshoot_mm(make, touches["reach"])}
        filtered_rows[name] = {f"{motion}_mm": rms_mm(make, some) for motion, some in filtered.items()}
    notes = (
        "time: one update and one prediction of one finger",
        "strokes, slide, straight: 10 cm/s, fast 30; noise 0.05 mm, quiet 0.02",
        "sines of 20 and 40 cm/s at most, circles of 15 and 30, a stop from 10 in 40 ms",
        "overshoot: the farthest prediction beyond the end of a reach, mean over all ends, noise included",
    )
    title = "prediction: RMS distance to the true position 15 ms ahead"
    noise = ("correlated noise of 0.025 mm, heavy-tailed errors of 0.65 ms along the way, positions held",)
    return (
        Table("prediction", title, rows, notes),
        Table("prediction_filtered", f"{title}, on a pad whose firmware filters", filtered_rows, noise),
    )


def rms_mm(make: Make, touches: Sequence[MotionTouch], ahead_s: float = AHEAD_S) -> float:
    """RMS error over the touches without the first samples of each."""
    errors_mm = [predicted_mm(make, one, ahead_s) - one.path.position_mm(one.sampled_s + ahead_s) for one in touches]
    counted = [error_mm[one.warm_up :] for one, error_mm in zip(touches, errors_mm, strict=True)]
    return math.sqrt(np.mean(np.sum(np.concatenate(counted) ** 2, axis=1)))


def predicted_mm(make: Make, touched: MotionTouch, ahead_s: float = AHEAD_S) -> FloatArray:
    """(T, 2): after each sample, the position predicted for `ahead_s` after the true time of that sample."""
    predictor = make()
    predicted = []
    for sample, t_s in zip(touched.samples, touched.sampled_s.tolist(), strict=True):
        predictor.update(*sample)
        predicted.append(predictor.predict(round((t_s + ahead_s) * 1e9)))
    return np.array(predicted)


def overshoot_mm(make: Make, touches: Sequence[MotionTouch]) -> float:
    """Distance of the farthest prediction beyond the end of a reach, mean over all ends."""
    farthest_mm = []
    for one in touches:
        assert isinstance(one.path, ReachPath)
        reach_mm = np.subtract(one.path.end_mm, one.path.start_mm)
        share = (predicted_mm(make, one) - one.path.start_mm) @ reach_mm / (reach_mm @ reach_mm)
        legs = ((one.sampled_s + AHEAD_S) // (one.path.duration_s + REST_AFTER_REACH_S)).astype(int)
        for leg in range(1, int(legs.max())):
            beyond = share[legs == leg] - 1.0 if leg % 2 == 0 else -share[legs == leg]
            farthest_mm.append(float(beyond.max()) * math.hypot(*reach_mm))
    return float(np.mean(farthest_mm))
