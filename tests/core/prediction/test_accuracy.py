"""Accuracy of the default predictor on the motions of a finger, through the pad of `hapticd.bench.motions`.

The pad samples at 100 or 88.9 Hz with white noise of 0.05 mm per axis, in steps of 0.02 mm, with stamps off by up to
1 ms. The error is the distance from the prediction to the true position 15 ms after the sampling; a motion and a seed
always give the same samples. The predictor does not know which of the two rates it gets.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.bench.motions import MOTIONS, PERIOD_S, MotionTouch, RotatedPath, sense, touch
from hapticd.bench.prediction import overshoot_mm, predicted_mm, rms_mm
from hapticd.core.prediction import make_predictor
from hapticd.sim.fingers.pad_noise import FILTERED_NOISE

Array = npt.NDArray[np.float64]

RATES = pytest.mark.parametrize("period_s", [0.010, 0.01125], ids=["100Hz", "88.9Hz"])
DIRECTION_RAD = 0.6  # nothing is special about it
# RMS error allowed at 15 and at 25 ms, mm.
GOALS_MM = {
    "rest": (0.015, 0.018),
    "straight": (0.065, 0.080),
    "fast_straight": (0.080, 0.095),
    "slide": (0.135, 0.210),
    "strokes": (0.125, 0.185),
    "quiet_strokes": (0.072, 0.115),
    "sine": (0.100, 0.140),
    "fast_sine": (0.18, 0.36),
    "circle": (0.145, 0.24),
    "fast_circle": (0.24, 0.55),
    "reach": (0.150, 0.250),
    "stop": (0.190, 0.390),
}


@cache
def touches(motion: str, period_s: float) -> tuple[MotionTouch, ...]:
    return tuple(touch(MOTIONS[motion], seed, period_s) for seed in range(6))


@cache
def rms_error_mm(motion: str, period_s: float, ahead_s: float = 0.015) -> float:
    return rms_mm(make_predictor, touches(motion, period_s), ahead_s)


@RATES
@pytest.mark.parametrize("motion", GOALS_MM)
def test_the_error_is_within_the_goal(motion: str, period_s: float) -> None:
    at_15_ms, at_25_ms = GOALS_MM[motion]
    assert rms_error_mm(motion, period_s) <= at_15_ms
    assert rms_error_mm(motion, period_s, ahead_s=0.025) <= at_25_ms


def test_a_reach_on_a_panel_of_240_hz_errs_by_an_eighth_of_a_millimetre_after_6_ms() -> None:
    """With the corrections of 15 ms, which are too large there, by 0.16 mm."""
    panel = [touch(MOTIONS["reach"], seed, 1.0 / 240.0, FILTERED_NOISE) for seed in range(6)]
    assert rms_mm(make_predictor, panel, 0.0065) <= 0.125


def test_the_mean_overshoot_of_a_reach_is_at_most_a_ninth_of_a_millimetre() -> None:
    """The bank alone, which is tuned to this noise, overshoots by 0.10 mm."""
    assert overshoot_mm(make_predictor, touches("reach", PERIOD_S)) <= 0.11


def errors_mm(touched: MotionTouch) -> Array:
    error_mm = predicted_mm(make_predictor, touched) - touched.path.position_mm(touched.sampled_s + 0.015)
    return np.hypot(*error_mm.T)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def sampled(along_mm: Callable[[Array], Array], seconds: float, period_s: float, seed: int) -> MotionTouch:
    return sense(RotatedPath(along_mm, DIRECTION_RAD), seconds, seed, period_s=period_s)


def straight_mm(t_s: Array) -> Array:
    return 100.0 * t_s


@RATES
def test_from_the_second_sample_on_a_moving_touch_down_is_followed(period_s: float) -> None:
    """No transient: RMS error by sample number of touches that land at 10 cm/s."""
    by_sample = np.array([errors_mm(sampled(straight_mm, 0.4, period_s, seed)) for seed in range(60)])
    for sample, most_mm in ((2, 0.35), (3, 0.30), (5, 0.22), (10, 0.16), (20, 0.11)):
        assert rms(by_sample[:, sample - 1]) < most_mm, sample


@RATES
def test_the_onset_of_motion_is_caught_up_within_a_few_samples(period_s: float) -> None:
    """Rest, then 10 cm/s within 60 ms."""

    def onset_mm(t_s: Array) -> Array:
        u = np.clip((t_s - 0.5) / 0.06, 0.0, 1.0)
        ramp_s = 0.06 * (u / 2.0 - np.sin(math.pi * u) / (2.0 * math.pi))
        return 100.0 * (ramp_s + np.maximum(t_s - 0.56, 0.0))

    peak, late = [], []
    for seed in range(40):
        touched = sampled(onset_mm, 0.9, period_s, seed)
        errors = errors_mm(touched)
        since_s = touched.sampled_s - 0.5
        peak.append(errors[(since_s > 0.0) & (since_s < 0.05)].max())
        late.append(errors[(since_s > 0.16) & (since_s < 0.2)])
    assert rms(np.array(peak)) < 0.75
    assert rms(np.concatenate(late)) < 0.2


@RATES
def test_the_overshoot_at_a_hard_stop_is_short(period_s: float) -> None:
    """10 cm/s, then to rest within 40 ms, at 52 mm."""

    def stop_mm(t_s: Array) -> Array:
        u = np.clip((t_s - 0.5) / 0.04, 0.0, 1.0)
        return 100.0 * (np.minimum(t_s, 0.5) + 0.04 * (u / 2.0 + np.sin(math.pi * u) / (2.0 * math.pi)))

    overshoots, samples_beyond = [], []
    for seed in range(40):
        x, y = predicted_mm(make_predictor, sampled(stop_mm, 0.9, period_s, seed)).T
        beyond_mm = x * math.cos(DIRECTION_RAD) + y * math.sin(DIRECTION_RAD) - 52.0
        overshoots.append(beyond_mm.max())
        samples_beyond.append(int(np.sum(beyond_mm > 0.3)))
    assert np.mean(overshoots) < 0.95
    assert np.mean(samples_beyond) < 2.1
    assert max(samples_beyond) <= 4


def moved_mm(one: MotionTouch, other: MotionTouch) -> Array:
    """Distances between the predictions for two versions of a touch."""
    return np.hypot(*(predicted_mm(make_predictor, one) - predicted_mm(make_predictor, other)).T)


@RATES
@pytest.mark.parametrize("off_ns", [-4_000_000, 4_000_000])
def test_a_stamp_4_ms_off_moves_the_prediction_by_less_than_0_33_mm(off_ns: int, period_s: float) -> None:
    touched = sampled(straight_mm, 3.0, period_s, seed=6)
    samples = touched.samples.copy()
    for k in range(60, len(samples), 50):
        t_ns, x_mm, y_mm = samples[k]
        samples[k] = (t_ns + off_ns, x_mm, y_mm)
    assert moved_mm(touched._replace(samples=samples), touched).max() < 0.33
