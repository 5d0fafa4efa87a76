"""Where a finger will be: every predictor's error on many motions, and what an update and a prediction cost.

The error is the distance, RMS, from the prediction to where the finger truly is 15 ms after the sampling, on the
motions of `motions`. Beside the predictors that one can choose stand the default without its parts, numpy's own
least-squares parabola, and the best linear filter of each single motion, fitted to it on other seeds: a bound for what
does not know which motion it sees.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from ..core.prediction.motion import Sample
from ..core.prediction.predictor import Predictor, PredictorFactory
from ..sim.fingers.paths import Reach
from .baselines import PREDICTORS
from .motions import MOTIONS, REST_AFTER_REACH_S, STROKES, TURNS, FloatArray, Motion, Touch, touch
from .tables import Table, finite_rows
from .timing import REPEATS, Timing, compare

DEFAULT = "default"
BOUND = "Wiener filter of each motion"
AHEAD_S, FAR_AHEAD_S = 0.015, 0.025
_TAPS = 20
_FITTED_SEEDS = range(50, 54)

Make = Callable[[], Predictor]


def run(*, seeds: Sequence[int] = range(6), repeats: int = REPEATS) -> tuple[Table, Table]:
    """Compare all predictors on a touch of each motion and seed: on strokes and slides, and where the finger turns."""
    touches = {name: [touch(motion, seed) for seed in seeds] for name, motion in MOTIONS.items()}
    update, query = _times(touches["strokes"][0], repeats)
    rows = []
    for name, make in alternatives().items():
        errors = {f"{motion}_mm": rms_mm(make, motion, played) for motion, played in touches.items()}
        errors["strokes_25ms_mm"] = rms_mm(make, "strokes", touches["strokes"], FAR_AHEAD_S)
        errors["overshoot_mm"] = overshoot_mm(make, touches["reach"])
        rows.append((name, {**update[name].figures(), **query[name].figures("query"), **errors}))
    rows.append((BOUND, {f"{name}_mm": _wiener_mm(motion, touches[name]) for name, motion in MOTIONS.items()}))
    strokes = ("time_us", "time_spread_us", "query_us", *_columns(STROKES), "strokes_25ms_mm")
    return (
        Table(
            name="prediction",
            title="prediction: RMS distance to the true position 15 ms ahead, on strokes, slides and at rest",
            default=DEFAULT,
            rows=finite_rows([(name, _some(figures, strokes)) for name, figures in rows]),
            compared=("time_us", "strokes_mm"),
            time="time_us",
            error="strokes_mm",
            notes=(
                "time: one update and one prediction of one finger; query: the prediction alone",
                "strokes, slide, straight: 10 cm/s, fast 20 and 30; noise 0.05 mm, quiet 0.02; strokes 25ms: that far",
            ),
        ),
        Table(
            name="prediction_turns",
            title="prediction: the same where a finger turns or stops",
            default=DEFAULT,
            rows=finite_rows(
                [(name, _some(figures, ("time_us", *_columns(TURNS), "overshoot_mm"))) for name, figures in rows]
            ),
            compared=("time_us", "reach_mm"),
            time="time_us",
            error="reach_mm",
            notes=(
                "sines of 10, 20, 40 cm/s at most, circles of 15 and 30 cm/s, a stop from 10 cm/s in 40 ms",
                "overshoot: mean of the farthest prediction beyond a reach's end, the noise's share in it",
            ),
        ),
    )


def alternatives() -> dict[str, Make]:
    """How to make a predictor of each kind, by name."""
    return {
        **PREDICTORS,
        "default, noise as given": partial(PREDICTORS[DEFAULT], noise_samples=0.0),
        "default, stamps as given": partial(PREDICTORS[DEFAULT], stamp_error_ms=0.0),
        "numpy polyfit": PredictorFactory.of(NumpyParabola),
    }


def rms_mm(make: Make, motion: str, touches: Sequence[Touch], ahead_s: float = AHEAD_S) -> float:
    """RMS error over the touches, the motion's warm-up left out."""
    warm_up = MOTIONS[motion].warm_up
    missed_mm = [(predicted_mm(make, one, ahead_s) - _truth_mm(one, ahead_s))[warm_up:] for one in touches]
    return _rms_mm(missed_mm)


def predicted_mm(make: Make, touched: Touch, ahead_s: float = AHEAD_S) -> FloatArray:
    """(T, 2): after each sample, where the finger is said to be `ahead_s` after the sample was truly taken."""
    predictor = make()
    foretold = []
    for sample, t_s in zip(touched.samples, touched.sampled_s.tolist(), strict=True):
        predictor.update(*sample)
        foretold.append(predictor.predict(round((t_s + ahead_s) * 1e9)))
    return np.array(foretold)


def overshoot_mm(make: Make, touches: Sequence[Touch]) -> float:
    """How far beyond the end of a reach the farthest prediction goes, the mean over all ends."""
    farthest_mm = []
    for one in touches:
        if not isinstance(one.path, Reach):
            raise TypeError("overshoot is defined for reaches")
        way_mm = np.subtract(one.path.end_mm, one.path.start_mm)
        share = (predicted_mm(make, one) - one.path.start_mm) @ way_mm / (way_mm @ way_mm)
        cycle_s = one.path.duration_s + REST_AFTER_REACH_S
        legs = ((one.sampled_s + AHEAD_S) // cycle_s).astype(int)
        for leg in range(1, int(legs.max())):
            beyond = share[legs == leg] - 1.0 if leg % 2 == 0 else -share[legs == leg]
            farthest_mm.append(float(beyond.max()) * math.hypot(*way_mm))
    return float(np.mean(farthest_mm))


class NumpyParabola:
    """The parabola through the last samples by numpy's own least squares, weighted as "least_squares" does."""

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
        degree = min(2, len(t_s) - 1)
        weights = np.exp(ages_s / (2.0 * self._WINDOW_S))  # numpy squares its weights
        fitted = np.polyfit(ages_s, np.stack((x_mm, y_mm), axis=-1), degree, w=weights)
        self._along_x, self._along_y = np.poly1d(fitted[:, 0]), np.poly1d(fitted[:, 1])

    def position(self, ahead_s: float) -> tuple[float, float]:
        return float(self._along_x(ahead_s)), float(self._along_y(ahead_s))

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        return float(self._along_x.deriv()(ahead_s)), float(self._along_y.deriv()(ahead_s))


def _wiener_mm(motion: Motion, touches: Sequence[Touch]) -> float:
    """RMS error of the linear filter over the last samples that errs least on this motion's touches of other seeds."""
    fitted = [_taps(touch(motion, seed), motion.warm_up) for seed in _FITTED_SEEDS]
    taps, wanted_mm = (np.concatenate(parts) for parts in zip(*fitted, strict=True))
    weights, *_ = np.linalg.lstsq(taps, wanted_mm, rcond=None)
    missed_mm = []
    for one in touches:
        taps, wanted_mm = _taps(one, motion.warm_up)
        missed_mm.append((taps @ weights - wanted_mm).reshape(2, -1).T)
    return _rms_mm(missed_mm)


def _taps(touched: Touch, warm_up: int) -> tuple[FloatArray, FloatArray]:
    """For x, then y, of each sample: the ones before it (2T, taps) and what is to come (2T,), all relative to it."""
    seen_mm = np.array([sample[1:] for sample in touched.samples])
    first = max(warm_up, _TAPS)
    windows = np.lib.stride_tricks.sliding_window_view(seen_mm, _TAPS + 1, axis=0)[first - _TAPS :]
    ahead_mm = (_truth_mm(touched, AHEAD_S) - seen_mm)[first:]
    before_mm = (windows - windows[..., -1:])[..., :-1]
    return before_mm.swapaxes(0, 1).reshape(-1, _TAPS), ahead_mm.T.reshape(-1)


def _truth_mm(touched: Touch, ahead_s: float) -> FloatArray:
    return touched.path.position_mm(touched.sampled_s + ahead_s)


def _times(touched: Touch, repeats: int) -> tuple[dict[str, Timing], dict[str, Timing]]:
    """By name: an update with a prediction, and a prediction alone."""
    samples = touched.samples
    makes = alternatives()
    whole = compare({name: (partial(_follow, make, samples), len(samples)) for name, make in makes.items()}, repeats)
    ready = {name: make() for name, make in makes.items()}
    for predictor in ready.values():
        for sample in samples:
            predictor.update(*sample)
    t_ns = samples[-1][0] + round(AHEAD_S * 1e9)
    asked = {name: (partial(_ask, predictor, t_ns, len(samples)), len(samples)) for name, predictor in ready.items()}
    return whole, compare(asked, repeats)


def _follow(make: Make, samples: Sequence[tuple[int, float, float]]) -> None:
    predictor = make()
    ahead_ns = round(AHEAD_S * 1e9)
    for t_ns, x_mm, y_mm in samples:
        predictor.update(t_ns, x_mm, y_mm)
        predictor.predict(t_ns + ahead_ns)


def _ask(predictor: Predictor, t_ns: int, times: int) -> None:
    for _ in range(times):
        predictor.predict(t_ns)


def _rms_mm(missed_mm: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.sum(np.concatenate(missed_mm) ** 2, axis=1))))


def _columns(motions: Mapping[str, Motion]) -> tuple[str, ...]:
    return tuple(f"{name}_mm" for name in motions)


def _some(figures: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    return {name: figures[name] for name in names if name in figures}
