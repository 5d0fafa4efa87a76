"""The clock filter: what is left of the stamps' jitter, lost reports, outliers, pads of another rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.touch.sensor_clock import SampleClock
from hapticd.values import FloatArray

KINDS = ("uniform", "two-step", "batched", "drifting")  # the second is too early or too late by the same amount
RATES_HZ, LOST_FRAC = (60.0, 88.9, 125.0, 240.0), (0.0, 0.05)
WORST_S = 6e-3  # half width of the stamps' errors
WRONG_S = 1.5e-3  # a mean error beyond is a wrong lock
SETTLED_S = 2.0
DRIFT_FRAC, DRIFT_S = 0.002, 2.5  # of the rate, up and down
LEAST_APART_S = 50e-6


class Train(NamedTuple):
    """Stamps and true sampling times (n,), in s."""

    stamps_s: FloatArray
    sampled_s: FloatArray


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
        (0.010, 0.010, 0.0001, {1: 0.58, 3: 0.46, 10: 0.31, 20: 0.29, 100: 0.15}),
        (0.010, 0.01125, 0.001, {1: 0.60, 3: 0.55, 10: 0.38, 20: 0.30, 100: 0.15}),
        (0.01125, 0.01125, 0.001, {1: 0.60, 3: 0.55, 10: 0.38, 20: 0.30, 100: 0.15}),
    ],
    ids=["known rate", "either rate, 100 Hz", "either rate, 88.9 Hz"],
)
def test_what_is_left_of_a_millisecond_of_jitter(
    period_s: float, clock_period_s: float, period_error_s: float, most_ms: dict[int, float]
) -> None:
    squares, runs = np.zeros(101), 150
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
        assert abs(clock.lag_s) < 0.25


def train(kind: str, rate_hz: float, lost_frac: float, seed: int, error_s: float, seconds: float = 6.0) -> Train:
    """Return the stamps of a sampler, one of `KINDS`, off by up to `error_s`."""
    rng = np.random.default_rng([seed, int(rate_hz), int(1000 * lost_frac), KINDS.index(kind)])
    s = np.asarray((np.arange(int(seconds * rate_hz)) + rng.uniform()) / rate_hz, np.float64)
    if kind == "drifting":
        turn = 2.0 * math.pi / DRIFT_S
        s = s + DRIFT_FRAC / turn * np.sin(turn * s + rng.uniform(0.0, 2.0 * math.pi))
    s = s[rng.random(len(s)) >= lost_frac]
    if kind == "two-step":
        stamps = s + np.where(rng.random(len(s)) < 0.5, -error_s, error_s)
    elif kind == "batched":
        poll_s, first_s = 2.0 * error_s, rng.uniform(0.0, 2.0 * error_s)
        stamps = first_s + poll_s * np.ceil((s - first_s) / poll_s) - error_s
    else:
        stamps = s + rng.uniform(-error_s, error_s, len(s))
    order = LEAST_APART_S * np.arange(len(s))
    return Train(np.maximum.accumulate(stamps - order) + order, s)


def left(one: Train) -> tuple[float, float]:
    """Return mean and RMS of what a fresh filter leaves, in s, but for a constant delay, which is not its to find."""
    late_s, lags_s = one.stamps_s - one.sampled_s, [0.0]
    clock = SampleClock(0.01125, 0.0007, 0.6e-3)  # as for the pad
    for elapsed_s in np.diff(one.stamps_s).tolist():
        clock.advance(elapsed_s)
        lags_s.append(clock.lag_s)
    is_settled = one.sampled_s > SETTLED_S
    error_s = (late_s - np.array(lags_s))[is_settled] - late_s[is_settled].mean()
    return float(error_s.mean()), math.sqrt(float(np.mean(error_s**2)))


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 50), marks=pytest.mark.long)], ids=["few", "all"])
def test_stamps_that_are_off_by_6_ms_lock_no_filter_to_a_wrong_phase(seeds: Sequence[int]) -> None:
    found = {case: left(train(*case, WORST_S)) for case in product(KINDS, RATES_HZ, LOST_FRAC, seeds)}
    assert [case for case, (mean_s, _) in found.items() if abs(mean_s) > WRONG_S] == []
    regular = [rms_s for (kind, _, lost, _), (_, rms_s) in found.items() if kind == "uniform" and lost == 0.0]
    assert max(regular) < 0.7 * WORST_S / math.sqrt(3.0), "and some of the jitter is gone"


@pytest.mark.parametrize("off_ms", [-8.0, -4.0, 4.0, 7.0])
def test_a_touch_down_off_the_sampling_grid_is_forgotten_by_the_third_sample(off_ms: float) -> None:
    period_s = 1.0 / 60.0
    stamps_s = [1.0 + 1e-3 * off_ms, *(1.0 + period_s * k for k in range(1, 12))]
    clock = SampleClock(period_s, 1e-3, 0.6e-3)
    errors_s = sampling_errors_s(clock, stamps_s, [1.0 + period_s * k for k in range(12)])
    assert max(map(abs, errors_s[2:])) < 0.6e-3


def test_a_lone_late_stamp_hardly_moves_the_clock() -> None:
    stamps_s = [1.0 + 0.008 * k for k in range(100)]
    sampled_s = stamps_s.copy()
    stamps_s[60] += 0.004
    errors_s = sampling_errors_s(SampleClock(0.01125, 1e-3, 0.6e-3), stamps_s, sampled_s)
    assert max(map(abs, errors_s[60:])) < 0.5e-3
