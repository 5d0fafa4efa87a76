"""Kalman gains of the constant-acceleration model driven by white jerk, and the table of them that the bank uses.

State (position, velocity, acceleration) of one axis, x(t+T) = x + vT + aT^2/2, process noise
Q = q [[T^5/20, T^4/8, T^3/6], [T^4/8, T^3/3, T^2/2], [T^3/6, T^2/2, T]], one position measured with variance r^2
(Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 2001, section 6.2.3). Gains do
not depend on the data, so those of a regular sampler are computed once, from the first sample to the steady state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import islice
from typing import NamedTuple

# White-jerk density of each moving model, mm^2/s^5: from a slow straight slide to a hard stop, 38 times apart.
JERK_DENSITIES = (9.7e3, 3.7e5, 1.4e7, 5.2e8)
REST_WALK_MM2_S = 1e-3  # a resting finger's position: random walk

STARTUP_STEPS = 60  # by then every model is within 0.1 % of its steady gain
_STEADY_STEPS = 800
_STEADY_CHANGE = 1e-12  # relative, from one step to the next

# What is known of a finger that has just come down: it moves at some 10 cm/s, in any direction.
_START_SPEED_VAR = 1e4  # mm^2/s^2
_START_ACCELERATION_VAR = 1e5  # mm^2/s^4


class Covariance(NamedTuple):
    """Upper triangle of the covariance of (position, velocity, acceleration); mm and s."""

    xx: float
    xv: float
    xa: float
    vv: float
    va: float
    aa: float


class Gain(NamedTuple):
    """What one mm of innovation adds to position, velocity (1/s), acceleration (1/s^2); its variance, mm^2."""

    position: float
    velocity: float
    acceleration: float
    innovation_mm2: float


def touchdown_covariance(noise_mm: float) -> Covariance:
    """After the first sample of a touch."""
    return Covariance(noise_mm * noise_mm, 0.0, 0.0, _START_SPEED_VAR, 0.0, _START_ACCELERATION_VAR)


def riccati_step(p: Covariance, interval_s: float, jerk_density: float, noise_mm: float) -> tuple[Covariance, Gain]:
    """Predict over `interval_s`, measure once: the covariance after, and the gain to measure with."""
    t = interval_s
    q = jerk_density * t
    aa = p.aa + q
    va = p.va + t * (p.aa + q / 2.0)
    vv = p.vv + t * (2.0 * p.va + t * (p.aa + q / 3.0))
    xa = p.xa + t * (p.va + t * (p.aa / 2.0 + q / 6.0))
    xv = p.xv + t * (p.vv + p.xa + t * (1.5 * p.va + t * (p.aa / 2.0 + q / 8.0)))
    xx = p.xx + t * (2.0 * p.xv + t * (p.vv + p.xa + t * (p.va + t * (p.aa / 4.0 + q / 20.0))))
    noise = noise_mm * noise_mm
    spread = xx + noise
    k_x, k_v, k_a = xx / spread, xv / spread, xa / spread
    left = noise / spread  # 1 - k_x, without its cancellation when the measurement is trusted
    after = Covariance(left * xx, left * xv, left * xa, vv - k_v * xv, va - k_v * xa, aa - k_a * xa)
    return after, Gain(k_x, k_v, k_a, spread)


def moving_gains(period_s: float, jerk_density: float, noise_mm: float) -> Iterator[Gain]:
    """Gains of the second, third, ... sample of a touch."""
    p = touchdown_covariance(noise_mm)
    while True:
        p, gain = riccati_step(p, period_s, jerk_density, noise_mm)
        yield gain


def rest_gains(period_s: float, noise_mm: float) -> Iterator[Gain]:
    """The same for a finger that does not move but for a slow random walk."""
    noise = noise_mm * noise_mm
    variance = noise
    while True:
        variance += REST_WALK_MM2_S * period_s
        spread = variance + noise
        yield Gain(variance / spread, 0.0, 0.0, spread)
        variance *= noise / spread


@lru_cache(maxsize=256)
def bank_gains(period_s: float, noise_mm: float) -> tuple[tuple[Gain, ...], ...]:
    """Rows of gains, one per sample after the first; the last row is the steady state.

    A row holds the rest model's gain, then those of the moving models in the order of `JERK_DENSITIES`.
    """
    moving = (moving_gains(period_s, density, noise_mm) for density in JERK_DENSITIES)
    columns = [_from_start_to_steady(gains) for gains in (rest_gains(period_s, noise_mm), *moving)]
    return tuple(zip(*columns, strict=True))


def _from_start_to_steady(gains: Iterator[Gain]) -> list[Gain]:
    column = list(islice(gains, STARTUP_STEPS))
    steady = column[-1]
    for later in islice(gains, _STEADY_STEPS - STARTUP_STEPS):
        settled = math.isclose(later.position, steady.position, rel_tol=_STEADY_CHANGE)
        steady = later
        if settled:
            break
    return [*column, steady]
