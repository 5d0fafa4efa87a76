"""Kalman gains of the models in the bank, from a touch's second sample to the steady state.

A model's order is the number of its states on one axis: 1 a random walk, 3 constant acceleration driven by white jerk,
4 constant jerk driven by white snap. State x = (position, velocity, ...), transition F_ij = T^(j-i) / (j-i)!, process
noise Q_ij = q T^k / (k (n-1-i)! (n-1-j)!) with k = 2n-1-i-j, one position measured with variance r^2 (Bar-Shalom, Li,
Kirubarajan: Estimation with Applications to Tracking and Navigation, 2001, section 6.2). Gains do not depend on the
data: those of regular samplers are computed once, for all intervals and densities together.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ...values import FloatArray

# Order and density of each model: a finger at rest (mm^2/s); white jerk of a straight slide, a hand's changes of speed
# and a hard stop (mm^2/s^5); white snap of a slow bend, a circle and a fast one (mm^2/s^7). Fitted on slides, reaches,
# circles, sines, stops and strokes together.
MODELS = ((1, 1e-3), (3, 3e3), (3, 3.7e5), (3, 5.2e8), (4, 3e7), (4, 1.1e9), (4, 1.3e10))

STEPS = 100  # every model of motion is within 0.1 % of its steady gain by then

# A finger that has just landed moves at some 10 cm/s in any direction: variances of velocity, acceleration and jerk,
# in mm and s.
_START_VARIANCES = (1e4, 1e5, 1e7)

_FACTORIAL = (1, 1, 2, 6)


# Corrections of position, velocity (1/s), acceleration (1/s^2) and jerk (1/s^3) per mm of innovation; the innovation's
# variance (mm^2).
Gain = tuple[float, float, float, float, float]


@lru_cache(maxsize=16)  # two configurations of some levels each
def bank_gains(intervals_s: tuple[float, ...], noise_mm: float) -> FloatArray:
    """Return the gains (intervals, STEPS, MODELS, 5) from the second sample on, in the order of a `Gain`; the last ones
    hold for all later samples. Takes some 20 ms the first time."""
    columns = [
        kalman_gains(intervals_s, [density for order_, density in MODELS if order_ == order], noise_mm, order)
        for order in sorted({order for order, _ in MODELS})
    ]
    return np.ascontiguousarray(np.concatenate(columns, axis=2).swapaxes(0, 1))


def kalman_gains(
    intervals_s: Sequence[float], densities: Sequence[float], noise_mm: float, order: int, steps: int = STEPS
) -> FloatArray:
    """Return gains (steps, intervals, densities, 5) from the second sample of a touch on, in the order of a `Gain`."""
    transition, process = process_model(np.asarray(intervals_s)[:, None], np.asarray(densities), order)
    noise_mm2 = noise_mm * noise_mm
    covariance = np.diag([noise_mm2, *_START_VARIANCES[: order - 1]])
    gains = np.zeros((steps, len(intervals_s), len(densities), 5))
    for step in gains:
        ahead = transition @ covariance @ transition.swapaxes(-1, -2) + process
        spread = ahead[..., 0, 0] + noise_mm2
        step[..., :order] = gain = ahead[..., 0] / spread[..., None]
        step[..., 4] = spread
        covariance = ahead - gain[..., :, None] * ahead[..., None, 0, :]
        first = (noise_mm2 / spread)[..., None] * ahead[..., 0]  # without 1 - k's cancellation
        covariance[..., 0, :] = covariance[..., :, 0] = first
    return gains


def process_model(
    interval_s: float | FloatArray, density: float | FloatArray, order: int
) -> tuple[FloatArray, FloatArray]:
    """Transition and process noise (..., n, n) of intervals and densities that broadcast to (...)."""
    powers = np.array([interval_s**power for power in range(2 * order)])
    transition = np.zeros((*powers.shape[1:], order, order))
    process = np.zeros((*np.broadcast_shapes(powers.shape[1:], np.shape(density)), order, order))
    for i in range(order):
        for j in range(order):
            power = 2 * order - 1 - i - j
            process[..., i, j] = (
                density * powers[power] / (power * _FACTORIAL[order - 1 - i] * _FACTORIAL[order - 1 - j])
            )
            if j >= i:
                transition[..., i, j] = powers[j - i] / _FACTORIAL[j - i]
    return transition, process
