"""The default model on pads whose noise is not white: filtered, held, quantised, and slow or fast to report."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.bench.baselines import PREDICTORS
from hapticd.core.prediction import Predictor, make_predictor
from hapticd.core.prediction.pad_memory import PadMemory, speed_class
from hapticd.sim.fingers.strokes import Strokes

Array = npt.NDArray[np.float64]
Samples = list[tuple[int, float, float]]


def low_passed(xy_mm: Array) -> Array:
    """A pad that averages its positions: half of each new one."""
    filtered = xy_mm.copy()
    for k in range(1, len(filtered)):
        filtered[k] = 0.5 * (filtered[k - 1] + filtered[k])
    return filtered


def held(xy_mm: Array) -> Array:
    """A pad with hysteresis: it reports once the finger is 0.1 mm from the last report."""
    reported = xy_mm.copy()
    for k in range(1, len(reported)):
        if math.dist(reported[k], reported[k - 1]) < 0.1:
            reported[k] = reported[k - 1]
    return reported


def in_steps(xy_mm: Array) -> Array:
    """A pad that counts in steps of 0.1 mm."""
    return 0.1 * np.round(10.0 * xy_mm)


PADS: dict[str, Callable[[Array], Array]] = {"filtered": low_passed, "held": held, "coarse": in_steps}


@cache
def touched(pad: str, seed: int, *, rate_hz: float = 100.0, seconds: float = 8.0, speed_mm_s: float = 100.0) -> Samples:
    """Strokes on a pad with 0.05 mm of noise before its firmware, stamps off by half a millisecond."""
    rng = np.random.default_rng([seed, 9])
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    xy_mm = PADS[pad](Strokes(100 + seed, speed_mm_s).position_mm(t_s) + 0.05 * rng.standard_normal((len(t_s), 2)))
    stamps_s = t_s + rng.uniform(-5e-4, 5e-4, len(t_s)) * min(1.0, 100.0 / rate_hz)
    return [(round(1e9 * t), x, y) for t, (x, y) in zip(stamps_s.tolist(), xy_mm.tolist(), strict=True)]


def errors_mm(predictor: Predictor, samples: Samples, ahead_s: float = 0.015) -> Array:
    """Errors (n, 2) against the pad's own later reports."""
    predicted = []
    for t_ns, x_mm, y_mm in samples:
        predictor.update(t_ns, x_mm, y_mm)
        predicted.append(predictor.predict(t_ns + round(1e9 * ahead_s)))
    t_s = np.array([t_ns for t_ns, _, _ in samples]) * 1e-9
    return missed_mm(samples, predicted, ahead_s)[t_s + ahead_s <= t_s[-1]]


def missed_mm(samples: Samples, predicted: list[tuple[float, float]], ahead_s: float) -> Array:
    t_s, xy_mm = np.array([t_ns for t_ns, _, _ in samples]) * 1e-9, np.array(samples)[:, 1:]
    truth_mm = np.stack([np.interp(t_s + ahead_s, t_s, axis) for axis in xy_mm.T], axis=-1)
    return np.asarray(np.array(predicted) - truth_mm)


def rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


@pytest.mark.parametrize("pad", PADS)
@pytest.mark.parametrize("ahead_s", [0.015, 0.025])
def test_on_every_kind_of_pad_it_is_no_worse_than_the_best_of_the_simple_ones(pad: str, ahead_s: float) -> None:
    def error_mm(name: str) -> float:
        return rms(np.concatenate([errors_mm(PREDICTORS[name](), touched(pad, seed), ahead_s)[50:] for seed in (1, 2)]))

    assert error_mm("default") < 1.0 * min(error_mm(name) for name in ("linear", "kalman_cv"))


def test_what_a_touch_taught_serves_the_next_one() -> None:
    memory = PadMemory()
    errors_mm(make_predictor(memory=memory), touched("filtered", 1))
    short = touched("filtered", 2)[:40]
    assert rms(errors_mm(make_predictor(memory=memory), short)) < 0.95 * rms(errors_mm(make_predictor(), short))


@pytest.mark.parametrize("pad", PADS)
@pytest.mark.parametrize("ahead_ms", [15, 25])
def test_two_thirds_of_the_errors_are_within_one_deviation_at_every_speed(pad: str, ahead_ms: int) -> None:
    """To five points, per class of speed, once the pad is known."""
    memory, within = PadMemory(), dict[int, list[npt.NDArray[np.bool_]]]()
    for seed in (1, 2, 3):
        for speed_mm_s in (30.0, 100.0, 250.0):
            samples = touched(pad, seed, seconds=5.0, speed_mm_s=speed_mm_s)
            predictor, predicted, sigma_mm, places = make_predictor(memory=memory), [], [], []
            for t_ns, x_mm, y_mm in samples:
                predictor.update(t_ns, x_mm, y_mm)
                predicted.append(predictor.predict(t_ns + 1_000_000 * ahead_ms))
                xx, _, yy = predictor.covariance(t_ns + 1_000_000 * ahead_ms)
                sigma_mm.append((math.sqrt(xx), math.sqrt(yy)))
                moved_mm = math.dist(predictor.predict(t_ns), predictor.predict(t_ns + 1_000_000))
                places.append(speed_class(1e3 * moved_mm))
            is_within = np.abs(missed_mm(samples, predicted, 1e-3 * ahead_ms)) <= np.array(sigma_mm)
            if seed > 1:
                for place, one in zip(places[:-5], is_within, strict=False):
                    within.setdefault(place, []).append(one)
    shares = {place: float(np.mean(some)) for place, some in within.items() if len(some) >= 250}
    assert len(shares) >= 3
    assert all(0.633 <= share <= 0.733 for share in shares.values()), shares
