"""Psychometric functions: a cumulative normal fitted to shares of right answers.

    p(x) = guess + (1 - guess - lapse) Phi((x - threshold) / spread)

At the threshold it is half way between guessing and lapses. Threshold, logarithm of the spread and lapse have flat
priors on a grid, which has no local optima to be trapped in: the estimate is the posterior's mean, the interval holds
95 % of its probability.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

from .experiment import CONFIDENCE

GRID = (81, 12, 3)  # thresholds, spreads, lapses
MAX_LAPSE_FRAC = 0.06
MARGIN = 0.5  # of the range of levels, by which a threshold may lie beyond
SPREADS = (0.02, 2.0)  # of that range

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Curve:
    """A fitted function, with 95 % intervals of its threshold. `is_bounded` tells whether they lie within the grid:
    where they do not, the levels did not reach it."""

    threshold: float
    threshold_interval: tuple[float, float]
    spread: float
    lapse_frac: float
    is_bounded: bool


def fit(track: Sequence[tuple[float, bool]], guess_frac: float, *, falls: bool | None = None) -> Curve | None:
    """Fit levels and whether the answers there were right (or, with a guess of 0, the first answer was given).

    It may fall, by `falls` or else by the answers. None for fewer than two levels.
    """
    presented = np.array([level for level, _ in track])
    is_right = np.array([float(right) for _, right in track])
    levels, place = np.unique(presented, return_inverse=True)
    if len(levels) < 2:
        return None
    trials = np.bincount(place).astype(float)
    rights: FloatArray = np.bincount(place, is_right).astype(float)
    if falls is None:
        falls = float((presented - presented.mean()) @ is_right) < 0
    sign = -1.0 if falls else 1.0
    thresholds, spreads, lapses, p = _grid(sign * levels, guess_frac)
    likelihood = np.log(p) @ rights + np.log1p(-p) @ (trials - rights)
    weights = np.exp(likelihood - likelihood.max())
    weights /= weights.sum()
    interval = _central(thresholds, weights)
    return Curve(
        threshold=sign * float(weights @ thresholds),
        threshold_interval=interval if sign > 0.0 else (-interval[1], -interval[0]),
        spread=math.exp(float(weights @ np.log(spreads))),
        lapse_frac=float(weights @ lapses),
        is_bounded=float(thresholds.min()) < interval[0] and interval[1] < float(thresholds.max()),
    )


def _central(values: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the values between which all but the tails of the weights lie, by half a step of the grid farther out."""
    tails = 0.5 * (1 - CONFIDENCE), 0.5 * (1 + CONFIDENCE)
    steps, place = np.unique(values, return_inverse=True)
    below = np.cumsum(np.bincount(place, weights))
    low, high = np.minimum(np.searchsorted(below, tails), len(steps) - 1)
    half = 0.5 * float(steps[1] - steps[0])
    return float(steps[low]) - half, float(steps[high]) + half


def _grid(levels: FloatArray, guess_frac: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return thresholds, spreads and lapses (points,), and their shares of right answers (points, levels)."""
    span = float(np.ptp(levels))
    thresholds = np.linspace(levels.min() - MARGIN * span, levels.max() + MARGIN * span, GRID[0])
    spreads = span * np.geomspace(*SPREADS, GRID[1])
    lapses = np.linspace(0.0, MAX_LAPSE_FRAC, GRID[2])
    threshold, spread, lapse = (one.ravel() for one in np.meshgrid(thresholds, spreads, lapses, indexing="ij"))
    z = (levels - threshold[:, np.newaxis]) / spread[:, np.newaxis]
    p = guess_frac + (1.0 - guess_frac - lapse[:, np.newaxis]) * stats.norm.cdf(z)
    return threshold, spread, lapse, np.clip(p, 1e-6, 1.0 - 1e-6)
