"""The gain tables against 40-digit arithmetic and against the published figures."""

from __future__ import annotations

from itertools import islice

import mpmath
import pytest

from hapticd.core.prediction_gains import (
    JERK_DENSITIES,
    REST_WALK_MM2_S,
    STARTUP_STEPS,
    bank_gains,
    moving_gains,
    rest_gains,
)

# Position, velocity (1/s), acceleration (1/s^2), innovation variance (mm^2) at T = 10 ms, r = 0.053 mm.
STEADY_AT_10_MS = [
    (0.057912, 0.0, 0.0, 0.0029817),
    (0.41124, 10.829, 142.59, 0.0047711),
    (0.62165, 29.626, 705.95, 0.0074244),
    (0.83150, 69.421, 2897.9, 0.016671),
    (0.96131, 127.56, 8462.9, 0.072606),
]


def exact_gains(period_s: float, jerk_density: float, noise_mm: float, steps: int) -> list[list[mpmath.mpf]]:
    """The matrix Riccati recursion as written in the books, in 40 digits, from the second sample on."""
    with mpmath.workdps(40):
        t, q, noise = mpmath.mpf(period_s), mpmath.mpf(jerk_density), mpmath.mpf(noise_mm) ** 2
        f = mpmath.matrix([[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]])
        process = q * mpmath.matrix(
            [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]
        )
        p = mpmath.diag([noise, mpmath.mpf(10) ** 4, mpmath.mpf(10) ** 5])
        gains = []
        for _ in range(steps):
            p = f * p * f.T + process
            spread = p[0, 0] + noise
            k = p[:, 0] / spread
            p = p - k * p[0, :]
            gains.append([k[0], k[1], k[2], spread])
        return gains


def test_steady_gains_are_the_published_ones_to_four_digits() -> None:
    for gain, expected in zip(bank_gains(0.010, 0.053)[-1], STEADY_AT_10_MS, strict=True):
        assert tuple(gain) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("period_s", [0.0005, 0.01125, 0.06])
@pytest.mark.parametrize("jerk_density", [JERK_DENSITIES[0], JERK_DENSITIES[-1]])
def test_every_gain_from_the_second_sample_on_is_exact(period_s: float, jerk_density: float) -> None:
    exact = exact_gains(period_s, jerk_density, 0.053, STARTUP_STEPS)
    for gain, expected in zip(moving_gains(period_s, jerk_density, 0.053), exact, strict=False):
        assert tuple(gain) == pytest.approx(tuple(map(float, expected)), rel=1e-9)


@pytest.mark.parametrize("noise_mm", [1e-4, 0.053, 10.0])
def test_the_rest_gain_settles_at_its_closed_form(noise_mm: float) -> None:
    """Steady random walk: k^2 / (1 - k) = q T / r^2."""
    *_, last = islice(rest_gains(0.01, noise_mm), 200_000 if noise_mm > 1.0 else 2000)
    ratio = REST_WALK_MM2_S * 0.01 / noise_mm**2
    expected = 2.0 / (1.0 + (1.0 + 4.0 / ratio) ** 0.5)
    assert last.position == pytest.approx(expected, rel=1e-6)


def test_gains_settle_within_the_start_up_rows() -> None:
    *_, last_of_start, steady = bank_gains(0.01125, 0.053)
    for early, late in zip(last_of_start, steady, strict=True):
        assert early.position == pytest.approx(late.position, rel=2e-3)


def test_a_table_is_computed_once() -> None:
    assert bank_gains(0.0123, 0.05) is bank_gains(0.0123, 0.05)
