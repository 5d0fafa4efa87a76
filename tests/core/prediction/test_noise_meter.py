"""The noise meter: white noise on any motion, ignored samples, and its effect on the bank."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.prediction.bank import ModelBank
from hapticd.core.prediction.motion import Sample
from hapticd.core.prediction.noise_meter import NoiseMeter

PERIOD_S = 0.01125
MOTIONS = {
    "rest": lambda t: 0.0 * t,
    "straight": lambda t: 300.0 * t,
    "bend": lambda t: 20.0 * np.sin(5.0 * t),
    "starts and stops": lambda t: 30.0 * np.sin(3.0 * t) ** 3,
}


def noisy(noise_mm: float, samples: int, seed: int = 1, motion: str = "rest") -> list[tuple[float, float]]:
    rng = np.random.default_rng(seed)
    way_mm = MOTIONS[motion](PERIOD_S * np.arange(samples))
    x_mm, y_mm = (way_mm + noise_mm * rng.standard_normal(samples) for _ in "xy")
    return list(zip(x_mm.tolist(), y_mm.tolist(), strict=True))


def fed(meter: NoiseMeter, points_mm: list[tuple[float, float]], periods: float = 1.0) -> NoiseMeter:
    for x_mm, y_mm in points_mm:
        meter.update(x_mm, y_mm, periods)
    return meter


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("noise_mm", [0.01, 0.05, 0.2])
def test_white_noise_is_measured_to_a_seventh_on_any_motion(noise_mm: float, motion: str) -> None:
    found = [fed(NoiseMeter(128), noisy(noise_mm, 200, seed, motion)).noise_mm(0.0) for seed in range(20)]
    assert np.mean(found) == pytest.approx(noise_mm, rel=0.1)
    assert np.std(found) < noise_mm / 7


def test_with_too_few_samples_it_returns_the_default() -> None:
    assert fed(NoiseMeter(128), noisy(0.05, 60)).noise_mm(0.123) == 0.123
    assert fed(NoiseMeter(128), noisy(0.05, 80)).noise_mm(0.123) != 0.123


def test_repeated_counts_of_a_resting_finger_do_not_lower_the_noise() -> None:
    moving = fed(NoiseMeter(128), noisy(0.05, 200))
    found = moving.noise_mm(0.0)
    fed(moving, [(1.0, 2.0)] * 500)
    assert moving.noise_mm(0.0) == pytest.approx(found, rel=0.1)


def test_a_lost_sample_adds_no_noise() -> None:
    straight = [(9.0 * k, -4.0 * k) for k in range(200)]
    meter = fed(
        NoiseMeter(128), [(x + dx, y + dy) for (x, y), (dx, dy) in zip(straight, noisy(0.05, 200), strict=True)]
    )
    before = meter.noise_mm(0.0)
    for k in range(200, 260, 3):
        meter.update(9.0 * k, -4.0 * k, 3.0)
    assert meter.noise_mm(0.0) == before


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.0, 10.0)), max_size=120))
def test_for_any_samples_the_noise_is_finite_and_not_negative(samples: list[tuple[float, float, float]]) -> None:
    meter = NoiseMeter(8)
    for x_mm, y_mm, periods in samples:
        meter.update(x_mm, y_mm, periods)
    assert 0.0 <= meter.noise_mm(0.05) < math.inf


@pytest.mark.parametrize(("noise_mm", "gain"), [(0.015, 0.9), (0.15, 0.9)])
def test_a_bank_with_a_wrong_noise_predicts_better_if_it_measures(noise_mm: float, gain: float) -> None:
    def rms_mm(noise_samples: float) -> float:
        errors_mm = []
        for seed in range(4):
            bank = ModelBank(period_ms=11.25, noise_samples=noise_samples)
            truth_mm = MOTIONS["starts and stops"](PERIOD_S * np.arange(500) + 0.015)
            points_mm = noisy(noise_mm, 500, seed, "starts and stops")
            bank.start(*points_mm[0])
            for k in range(1, 500):
                bank.step(Sample(PERIOD_S, PERIOD_S, *points_mm[k]))
                if k > 200:
                    x_mm, y_mm = bank.position(0.015)
                    errors_mm.append(math.hypot(x_mm - truth_mm[k], y_mm - truth_mm[k]))
        return math.sqrt(np.mean(np.square(errors_mm)))

    assert rms_mm(128.0) < gain * rms_mm(0.0)


def test_measuring_the_expected_noise_changes_nothing() -> None:
    measuring, fixed = ModelBank(period_ms=11.25), ModelBank(period_ms=11.25, noise_samples=0.0)
    points_mm = noisy(0.053, 400, seed=3, motion="bend")
    for bank in (measuring, fixed):
        bank.start(*points_mm[0])
        for x_mm, y_mm in points_mm[1:]:
            bank.step(Sample(PERIOD_S, PERIOD_S, x_mm, y_mm))
    assert measuring.position(0.015) == fixed.position(0.015)
