"""The clock filter: what is left of the stamps' jitter, lost reports, outliers, pads of another rate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.touch.sample_clock import SampleClock


def sampling_errors_s(clock: SampleClock, stamps_s: list[float], sampled_s: list[float]) -> list[float]:
    """Estimated minus true sampling time, sample by sample."""
    errors = [stamps_s[0] - sampled_s[0]]
    for k in range(1, len(stamps_s)):
        clock.advance(stamps_s[k] - stamps_s[k - 1])
        errors.append(stamps_s[k] - clock.lag_s - sampled_s[k])
    return errors


@pytest.mark.parametrize(
    ("period_s", "clock_period_s", "period_error_s", "most_ms"),
    [
        (0.010, 0.010, 0.0001, {1: 0.46, 3: 0.36, 10: 0.31, 20: 0.29, 100: 0.15}),
        (0.010, 0.01125, 0.001, {1: 0.60, 3: 0.55, 10: 0.38, 20: 0.30, 100: 0.15}),
        (0.01125, 0.01125, 0.001, {1: 0.60, 3: 0.55, 10: 0.38, 20: 0.30, 100: 0.15}),
    ],
    ids=["known rate", "either rate, 100 Hz", "either rate, 88.9 Hz"],
)
def test_what_is_left_of_a_millisecond_of_jitter(
    period_s: float, clock_period_s: float, period_error_s: float, most_ms: dict[int, float]
) -> None:
    squares = np.zeros(101)
    runs = 150
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        sampled = np.arange(101) * period_s
        stamps = sampled + rng.uniform(-1e-3, 1e-3, 101)
        clock = SampleClock(clock_period_s, period_error_s, 0.6e-3)
        squares += np.square(sampling_errors_s(clock, stamps.tolist(), sampled.tolist()))
    for sample, bound_ms in most_ms.items():
        assert math.sqrt(squares[sample] / runs) * 1e3 < bound_ms, sample


@pytest.mark.parametrize("period_s", [0.001, 0.004, 0.0075, 0.0166, 0.0225, 0.030])
def test_a_pad_of_a_very_different_rate_is_followed_after_some_samples(period_s: float) -> None:
    clock = SampleClock(0.01125, 0.001, 0.6e-3)
    intervals = [clock.advance(period_s) for _ in range(60)]
    assert intervals[-1] == pytest.approx(period_s, rel=0.02)
    assert period_s / clock.period_s == pytest.approx(round(period_s / clock.period_s), abs=0.03)


@settings(max_examples=200)
@given(
    gaps=st.lists(st.floats(1e-9, 0.06), max_size=60),
    period_s=st.floats(0.0005, 0.05),
    period_error_s=st.floats(0.0, 0.01),
    stamp_error_s=st.floats(0.0, 0.01),
)
def test_whatever_the_stamps_intervals_and_period_stay_positive_and_finite(
    gaps: list[float], period_s: float, period_error_s: float, stamp_error_s: float
) -> None:
    clock = SampleClock(period_s, period_error_s, stamp_error_s)
    for gap in gaps:
        assert 0.0 < clock.advance(gap) < 1.0
        assert 0.0 < clock.period_s < 1.0
        assert abs(clock.lag_s) < 0.1


def test_stamps_that_jitter_more_than_expected_are_measured_and_trusted_less() -> None:
    squares_ms2, raw_ms2 = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sampled_s = np.arange(201) * 0.01125
        stamps_s = sampled_s + rng.uniform(-3e-3, 3e-3, 201)
        clock = SampleClock(0.01125, 0.0001, 0.6e-3)
        errors_s = sampling_errors_s(clock, stamps_s.tolist(), sampled_s.tolist())[100:]
        squares_ms2 += [(error_s * 1e3) ** 2 for error_s in errors_s]
        raw_ms2 += np.square((stamps_s - sampled_s)[100:] * 1e3).tolist()
        assert clock._stamp_var == pytest.approx(3e-6, rel=0.6)  # uniform over 6 ms
    assert math.sqrt(np.mean(squares_ms2)) < 0.35 * math.sqrt(np.mean(raw_ms2))
