"""Predictors: error on many motions, and the run time of an update and a prediction.

The error is the RMS distance between the prediction and the true position of the finger 15 ms after the sampling, on
the motions of `motions`. The library for comparison is numpy's least-squares parabola.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from ..core.prediction.motion import MotionModel, Sample
from ..core.prediction.predictor import Predictor, PredictorFactory
from ..sim.fingers.paths import ReachPath
from ..values import FloatArray
from .baselines import PREDICTORS
from .motions import MOTIONS, REST_AFTER_REACH_S, STROKES, TURNS, MotionTouch, filtered_touch, touch
from .tables import Table, finite_rows
from .timing import REPEATS, compare

DEFAULT = "default"
LIBRARY = "numpy polyfit"
AHEAD_S, FAR_AHEAD_S = 0.015, 0.025
FILTERED = ("strokes", "fast_strokes", "slide", "straight", "rest", "sine", "circle", "reach", "stop")

Make = Callable[[], Predictor]


def run(*, seeds: Sequence[int] = range(6), repeats: int = REPEATS) -> tuple[Table, Table, Table]:
    """Compare all predictors on a touch of each motion and seed: strokes and slides, turns and stops, and some of both
    on a pad whose firmware filters."""
    touches = {name: [touch(motion, seed) for seed in seeds] for name, motion in MOTIONS.items()}
    filtered = {name: [filtered_touch(MOTIONS[name], seed) for seed in seeds] for name in FILTERED}
    timed = touches["strokes"][0].samples
    times = compare(
        {name: (partial(_follow, make, timed), len(timed)) for name, make in alternatives().items()}, repeats
    )
    rows, filtered_rows = [], []
    for name, make in alternatives().items():
        errors = {f"{motion}_mm": rms_mm(make, motion, of_seeds) for motion, of_seeds in touches.items()}
        errors["strokes_25ms_mm"] = rms_mm(make, "strokes", touches["strokes"], FAR_AHEAD_S)
        errors["overshoot_mm"] = overshoot_mm(make, touches["reach"])
        rows.append((name, {**times[name].figures(), **errors}))
        errors = {f"{motion}_mm": rms_mm(make, motion, of_seeds) for motion, of_seeds in filtered.items()}
        filtered_rows.append((name, {**times[name].figures(), **errors}))
    return (
        _table(
            "prediction",
            "prediction: RMS distance to the true position 15 ms ahead, on strokes, slides and at rest",
            rows,
            [*(f"{motion}_mm" for motion in STROKES), "strokes_25ms_mm"],
            "strokes, slide, straight: 10 cm/s, fast 20 and 30; noise 0.05 mm, quiet 0.02; strokes 25ms: 25 ms ahead",
        ),
        _table(
            "prediction_turns",
            "prediction: the same where a finger turns or stops",
            rows,
            [*(f"{motion}_mm" for motion in TURNS), "overshoot_mm"],
            "sines of 10, 20, 40 cm/s at most, circles of 15 and 30 cm/s, a stop from 10 cm/s in 40 ms; overshoot: the "
            "farthest prediction beyond the end of a reach, mean over all ends, noise included",
        ),
        _table(
            "prediction_filtered",
            "prediction: the same on a pad whose firmware filters",
            filtered_rows,
            [f"{motion}_mm" for motion in FILTERED],
            "correlated noise of 0.025 mm, heavy-tailed errors of 0.65 ms along the way, positions held within 0.06 mm",
        ),
    )


def _table(
    name: str, title: str, rows: Sequence[tuple[str, Mapping[str, float]]], errors: Sequence[str], note: str
) -> Table:
    shown = ("time_us", "time_spread_us", *errors)
    error = "strokes_mm" if "strokes_mm" in errors else "reach_mm"
    return Table(
        name=name,
        title=title,
        default=DEFAULT,
        rows=finite_rows([(row, {figure: figures[figure] for figure in shown}) for row, figures in rows]),
        compared=("time_us", error),
        time="time_us",
        error=error,
        notes=("time: one update and one prediction of one finger", note),
    )


def alternatives() -> dict[str, Make]:
    """Return a constructor for each kind of predictor, by name."""
    return {**PREDICTORS, LIBRARY: PredictorFactory.of(NumpyParabola)}


def rms_mm(make: Make, motion: str, touches: Sequence[MotionTouch], ahead_s: float = AHEAD_S) -> float:
    """RMS error over the touches without the motion's warm-up."""
    warm_up = MOTIONS[motion].warm_up
    errors_mm = [predicted_mm(make, one, ahead_s) - one.path.position_mm(one.sampled_s + ahead_s) for one in touches]
    return math.sqrt(np.mean(np.sum(np.concatenate([error_mm[warm_up:] for error_mm in errors_mm]) ** 2, axis=1)))


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
        if not isinstance(one.path, ReachPath):
            raise TypeError("overshoot is defined for reaches")
        reach_mm = np.subtract(one.path.end_mm, one.path.start_mm)
        share = (predicted_mm(make, one) - one.path.start_mm) @ reach_mm / (reach_mm @ reach_mm)
        cycle_s = one.path.duration_s + REST_AFTER_REACH_S
        legs = ((one.sampled_s + AHEAD_S) // cycle_s).astype(int)
        for leg in range(1, int(legs.max())):
            beyond = share[legs == leg] - 1.0 if leg % 2 == 0 else -share[legs == leg]
            farthest_mm.append(float(beyond.max()) * math.hypot(*reach_mm))
    return float(np.mean(farthest_mm))


class NumpyParabola(MotionModel):
    """The parabola through the last eight samples by numpy's least squares; weights decay with 17 ms of age."""

    __slots__ = ("_along_x", "_along_y", "_samples")
    _WINDOW_S = 0.017

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=8)
        self._along_x = self._along_y = np.poly1d([math.nan])

    def start(self, x_mm: float, y_mm: float) -> None:
        self._samples.clear()
        self._samples.append((0.0, x_mm, y_mm))
        self._along_x, self._along_y = np.poly1d([x_mm]), np.poly1d([y_mm])

    def step(self, sample: Sample) -> None:
        self._samples.append((self._samples[-1][0] + sample.interval_s, sample.x_mm, sample.y_mm))
        t_s, x_mm, y_mm = np.array(self._samples).T
        ages_s = t_s - t_s[-1]
        weights = np.exp(ages_s / (2.0 * self._WINDOW_S))  # numpy squares its weights
        fitted = np.polyfit(ages_s, np.stack((x_mm, y_mm), axis=-1), min(2, len(t_s) - 1), w=weights)
        self._along_x, self._along_y = np.poly1d(fitted[:, 0]), np.poly1d(fitted[:, 1])

    def position(self, ahead_s: float) -> tuple[float, float]:
        return float(self._along_x(ahead_s)), float(self._along_y(ahead_s))

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        return float(self._along_x.deriv()(ahead_s)), float(self._along_y.deriv()(ahead_s))


def _follow(make: Make, samples: Sequence[tuple[int, float, float]]) -> None:
    predictor = make()
    ahead_ns = round(AHEAD_S * 1e9)
    for t_ns, x_mm, y_mm in samples:
        predictor.update(t_ns, x_mm, y_mm)
        predictor.predict(t_ns + ahead_ns)
