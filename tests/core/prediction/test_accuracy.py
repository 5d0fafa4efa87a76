"""How near the default predictor comes, on motions a finger makes, through the sensor as specified.

Sensor: regular sampling at 100 or 88.9 Hz, white noise of 0.05 mm per axis, positions in steps of 0.02 mm, stamps off
by up to 1 ms. The error is the distance from the prediction to where the finger truly is 15 ms after the sampling;
each motion and seed always gives the same samples. The predictor does not know which of the two rates it gets.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.core.prediction.predictor import make_predictor

Array = npt.NDArray[np.float64]
Path = Callable[[Array], tuple[Array, Array]]

RATES = pytest.mark.parametrize("period_s", [0.010, 0.01125], ids=["100Hz", "88.9Hz"])
NOISE_MM, STEP_MM, STAMP_ERROR_S = 0.05, 0.02, 1e-3
DIRECTION = 0.6  # rad: nothing is special about it


def along(distance_mm: Array, aside_mm: Array | float = 0.0) -> tuple[Array, Array]:
    """A path given by how far it goes, laid at an angle over the plate."""
    cos, sin = math.cos(DIRECTION), math.sin(DIRECTION)
    return -50.0 + cos * distance_mm - sin * aside_mm, -30.0 + sin * distance_mm + cos * aside_mm


def rest(t: Array) -> tuple[Array, Array]:
    return along(np.full_like(t, 41.7))


def straight(speed_mm_s: float) -> Path:
    return lambda t: along(speed_mm_s * t)


def glide(t: Array) -> tuple[Array, Array]:
    """10 cm/s as a hand does it: the speed varies by a tenth, the path wobbles, the finger trembles."""
    slow, fast = 2.0 * math.pi * 1.3, 2.0 * math.pi * 3.1
    distance = 100.0 * (t - 0.05 * np.cos(slow * t) / slow - 0.05 * np.cos(fast * t) / fast)
    aside = 0.4 * np.sin(2.0 * math.pi * 2.0 * t) + 0.04 * np.sin(2.0 * math.pi * 8.5 * t)
    return along(distance, aside)


def reach(t: Array) -> tuple[Array, Array]:
    """Minimum jerk over 50 mm in 0.45 s (Flash and Hogan 1985), from rest to rest."""
    u = np.clip((t - 0.4) / 0.45, 0.0, 1.0)
    return along(50.0 * u**3 * (10.0 - 15.0 * u + 6.0 * u * u))


def stop(t: Array) -> tuple[Array, Array]:
    """10 cm/s, then to rest within 40 ms: the end of a slide against a wall."""
    u = np.clip((t - 0.5) / 0.04, 0.0, 1.0)
    return along(100.0 * (np.minimum(t, 0.5) + 0.04 * (u / 2.0 + np.sin(math.pi * u) / (2.0 * math.pi))))


STOP_MM = 100.0 * 0.52


@dataclass(frozen=True)
class Touch:
    """What the sensor gave, and when it was really taken."""

    stamps_ns: list[int]
    x_mm: list[float]
    y_mm: list[float]
    sampled_s: Array


def sense(path: Path, seconds: float, period_s: float, seed: int) -> Touch:
    rng = np.random.default_rng(seed)
    sampled_s = np.arange(int(seconds / period_s)) * period_s + rng.uniform(0.0, period_s)
    x, y = path(sampled_s)
    x, y = (STEP_MM * np.round((axis + NOISE_MM * rng.standard_normal(len(axis))) / STEP_MM) for axis in (x, y))
    stamps = np.rint(1e9 * (sampled_s + rng.uniform(-STAMP_ERROR_S, STAMP_ERROR_S, len(x)))).astype(int)
    return Touch(stamps.tolist(), x.tolist(), y.tolist(), sampled_s)


def predictions(touch: Touch, name: str = "default", ahead_s: float = 0.015) -> tuple[Array, Array]:
    """Positions foretold after each sample for `ahead_s` after its sampling."""
    predictor = make_predictor(name)
    foretold = []
    targets_ns = np.rint(1e9 * (touch.sampled_s + ahead_s)).astype(int).tolist()
    for t_ns, x, y, target_ns in zip(touch.stamps_ns, touch.x_mm, touch.y_mm, targets_ns, strict=True):
        predictor.update(t_ns, x, y)
        foretold.append(predictor.predict(target_ns))
    xs, ys = np.array(foretold).T
    return xs, ys


def errors_mm(path: Path, touch: Touch, name: str = "default", ahead_s: float = 0.015) -> Array:
    x, y = predictions(touch, name, ahead_s)
    true_x, true_y = path(touch.sampled_s + ahead_s)
    return np.hypot(x - true_x, y - true_y)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@cache
def rms_error_mm(motion: str, period_s: float, name: str = "default", ahead_s: float = 0.015) -> float:
    path, seconds, warm_up, _ = MOTIONS[motion]
    touches = [sense(path, seconds, period_s, seed) for seed in range(4)]
    return rms(np.concatenate([errors_mm(path, touch, name, ahead_s)[warm_up:] for touch in touches]))


# Path, seconds, samples of warm-up left out, the worst RMS error allowed at 15 and at 25 ms.
MOTIONS: dict[str, tuple[Path, float, int, tuple[float, float]]] = {
    "rest": (rest, 3.0, 40, (0.015, 0.018)),
    "straight10": (straight(100.0), 3.0, 40, (0.065, 0.080)),
    "straight30": (straight(300.0), 3.0, 40, (0.080, 0.095)),
    "glide10": (glide, 3.0, 40, (0.125, 0.180)),
    "reach": (reach, 1.4, 8, (0.135, 0.240)),
    "stop10": (stop, 0.9, 8, (0.165, 0.330)),
}


@RATES
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_error_is_within_the_goal(motion: str, period_s: float) -> None:
    at_15_ms, at_25_ms = MOTIONS[motion][3]
    assert rms_error_mm(motion, period_s) <= at_15_ms
    assert rms_error_mm(motion, period_s, ahead_s=0.025) <= at_25_ms


@RATES
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("simpler", ["hold", "linear"])
def test_it_beats_the_simple_ones_on_every_motion(motion: str, simpler: str, period_s: float) -> None:
    assert rms_error_mm(motion, period_s) < 0.75 * rms_error_mm(motion, period_s, simpler)


@RATES
def test_a_resting_finger_s_prediction_hardly_moves_from_sample_to_sample(period_s: float) -> None:
    x, y = predictions(sense(rest, 3.0, period_s, seed=5))
    assert rms(np.hypot(np.diff(x), np.diff(y))[40:]) < 0.015


@RATES
def test_from_the_second_sample_on_a_moving_touch_down_is_followed(period_s: float) -> None:
    """No wake-up transient: RMS error by sample number of touches that land at 10 cm/s."""
    path = straight(100.0)
    by_sample = np.array([errors_mm(path, sense(path, 0.4, period_s, seed)) for seed in range(60)])
    second, third, fifth, tenth, twentieth = (rms(by_sample[:, k - 1]) for k in (2, 3, 5, 10, 20))
    assert second < 0.35
    assert third < 0.30
    assert fifth < 0.22
    assert tenth < 0.16
    assert twentieth < 0.11


@RATES
def test_the_onset_of_motion_is_caught_up_within_a_few_samples(period_s: float) -> None:
    """Rest, then 10 cm/s within 60 ms."""

    def onset(t: Array) -> tuple[Array, Array]:
        u = np.clip((t - 0.5) / 0.06, 0.0, 1.0)
        ramp = 0.06 * (u / 2.0 - np.sin(math.pi * u) / (2.0 * math.pi))
        return along(100.0 * (ramp + np.maximum(t - 0.56, 0.0)))

    peak, late = [], []
    for seed in range(40):
        touch = sense(onset, 0.9, period_s, seed)
        errors = errors_mm(onset, touch)
        since = touch.sampled_s - 0.5
        peak.append(errors[(since > 0.0) & (since < 0.05)].max())
        late.append(errors[(since > 0.16) & (since < 0.2)])
    assert rms(np.array(peak)) < 0.75
    assert rms(np.concatenate(late)) < 0.2


@RATES
def test_the_overshoot_at_a_hard_stop_is_short(period_s: float) -> None:
    overshoots, samples_beyond = [], []
    for seed in range(40):
        x, y = predictions(sense(stop, 0.9, period_s, seed))
        beyond = (x + 50.0) * math.cos(DIRECTION) + (y + 30.0) * math.sin(DIRECTION) - STOP_MM
        overshoots.append(beyond.max())
        samples_beyond.append(int(np.sum(beyond > 0.3)))
    assert np.mean(overshoots) < 0.95
    assert np.mean(samples_beyond) < 2.0
    assert max(samples_beyond) <= 4


def with_duplicates(touch: Touch, every: int) -> Touch:
    """Now and then the pad repeats its last report 6 ms after it, in place of the next."""
    stamps, x, y = touch.stamps_ns.copy(), touch.x_mm.copy(), touch.y_mm.copy()
    for k in range(every, len(stamps), every):
        stamps[k], x[k], y[k] = stamps[k - 1] + 6_000_000, x[k - 1], y[k - 1]
    return Touch(stamps, x, y, touch.sampled_s)


@RATES
def test_a_stale_duplicate_moves_the_prediction_by_less_than_a_third_of_a_millimetre(period_s: float) -> None:
    touch = sense(glide, 4.0, period_s, seed=9)
    x, y = predictions(touch)
    disturbed_x, disturbed_y = predictions(with_duplicates(touch, every=60))
    moved = np.hypot(disturbed_x - x, disturbed_y - y)
    assert 0.0 < moved.max() < 0.3


@RATES
@pytest.mark.parametrize("lost", [1, 3])
def test_lost_frames_hardly_show_when_the_finger_is_heard_again(lost: int, period_s: float) -> None:
    path = straight(100.0)
    touch = sense(path, 2.0, period_s, seed=4)
    kept = [k for k in range(len(touch.stamps_ns)) if k < 100 or (k - 100) % 10 >= lost]
    gappy = Touch(
        [touch.stamps_ns[k] for k in kept],
        [touch.x_mm[k] for k in kept],
        [touch.y_mm[k] for k in kept],
        touch.sampled_s[kept],
    )
    assert rms(errors_mm(path, gappy)[100:]) < 0.09


@RATES
@pytest.mark.parametrize("off_ns", [-4_000_000, 4_000_000])
def test_a_stamp_four_milliseconds_off_moves_the_prediction_by_less_than_a_third_of_a_millimetre(
    off_ns: int, period_s: float
) -> None:
    touch = sense(straight(100.0), 3.0, period_s, seed=6)
    stamps = touch.stamps_ns.copy()
    for k in range(60, len(stamps), 50):
        stamps[k] += off_ns
    x, y = predictions(touch)
    disturbed_x, disturbed_y = predictions(Touch(stamps, touch.x_mm, touch.y_mm, touch.sampled_s))
    assert np.hypot(disturbed_x - x, disturbed_y - y).max() < 0.33


@RATES
def test_jittered_stamps_cost_little_once_the_clock_has_locked(period_s: float) -> None:
    touches = [sense(glide, 3.0, period_s, seed) for seed in range(4)]
    exact = [Touch(np.rint(1e9 * t.sampled_s).astype(int).tolist(), t.x_mm, t.y_mm, t.sampled_s) for t in touches]
    jittered = rms(np.concatenate([errors_mm(glide, touch)[20:] for touch in touches]))
    assert jittered < 1.1 * rms(np.concatenate([errors_mm(glide, touch)[20:] for touch in exact]))


@pytest.mark.parametrize("period_s", [0.0075, 0.0166, 0.0225, 0.030])
def test_pads_of_other_rates_are_served_without_being_told(period_s: float) -> None:
    """133 and 60 Hz; every second report lost at 88.9 Hz; 33 Hz: fixed gains must not become unstable."""
    path = straight(100.0)
    touches = [sense(path, 4.0, period_s, seed) for seed in range(3)]
    assert rms(np.concatenate([errors_mm(path, touch)[40:] for touch in touches])) < 0.09
