"""What is learned of a pad while it is touched: how to correct the bank, and how far off the result is.

No model of the pad's noise is assumed. Each prediction is compared with what the pad reports once its horizon has
passed. Five corrections (`Vector`) are weighted so that the sum of squared errors is least; they are

    0   the bank's velocity, times the horizon
    1   its acceleration, times half the horizon squared
    2   the last reported position less the bank's
    3   the position of a slow filter less the bank's
    4   its velocity less the bank's, times the horizon

For each of two horizons: recursive least squares that forget, in the information form, with a normal prior on the
weights (`prior`): matrix A = sum f f^T, right side b = sum f d, and (A + s^2 L) w = b + s^2 L w0, where s^2 is the
residual's variance. One Gauss-Seidel sweep a sample follows the solution closely enough, as A changes slowly. The
weights of other horizons are on the straight line through the two.

The spread of the error along and across the motion is the 68 % quantile of its size, tracked in octaves of speed by
steps of a fixed ratio (Robbins and Monro, A Stochastic Approximation Method, Annals of Mathematical Statistics 22,
1951). It belongs to the positions that the pad reports, whose noise it includes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .prior import FAR, NEAR, SPREADS_MM, MotionVector, Prior

NEAR_S: Final = 0.015
FAR_S: Final = 0.030
MOST_WEIGHT: Final = 8.0  # beyond three deviations of every prior

_FORGET: Final = 0.998  # per sample: 5 s
_START_SAMPLES: Final = 4.0  # for which the initial residual counts
_START_RESIDUAL_MM2: Final = 0.1  # typical of real pads; a smaller one would let a quiet start fix the weights
_OUTLIER: Final = 5.0  # deviations: an error beyond counts by its size, not its square (Huber 1964)
_FARTHEST_U: Final = 4.0 / 3.0  # of the line through both horizons: 35 ms, the longest horizon of the loop

SLOWEST_MM_S: Final = 5.0  # upper edge of the lowest class of speed; each next one is an octave
CLASSES: Final = len(SPREADS_MM[0][0])
_SHARE_WITHIN: Final = 0.6827
_STEP: Final = 0.1  # of the common scale, relative, per error
_CLASS_STEP: Final = 0.03  # of one class, once it has seen many; 1 / (errors + _CLASS_START) before
_CLASS_START: Final = 8.0
_LEAST_SPREAD_MM: Final = 1e-3
_MOST_SPREAD_MM: Final = 1e2
_LEAST_SCALE: Final = 0.1
_MOST_SCALE: Final = 10.0


class HorizonFit:
    """Weights of the corrections at one horizon."""

    def __init__(self, prior: Prior, weights: MotionVector | None = None) -> None:
        """`weights` replaces the prior's mean: those that were kept of this pad."""
        self._start = prior.mean if weights is None else weights
        self.weights = self._start
        self._prior0, self._prior1, self._prior2, self._prior3, self._prior4 = prior.precision
        zero = 0.0, 0.0, 0.0, 0.0, 0.0
        self._row0 = self._row1 = self._row2 = self._row3 = self._row4 = self._right = zero
        self._count = _START_SAMPLES
        self._squares_mm2 = _START_SAMPLES * _START_RESIDUAL_MM2

    def learn(self, fx: MotionVector, fy: MotionVector, dx_mm: float, dy_mm: float) -> tuple[float, float]:
        """Take the corrections (mm, per axis) of a prediction and what they should have added up to; return what they
        lacked."""
        w = self.weights
        ex, ey = dx_mm - dot(fx, w), dy_mm - dot(fy, w)
        variance, square_mm2 = self._squares_mm2 / self._count, 0.5 * (ex * ex + ey * ey)
        usual_mm2 = _OUTLIER * _OUTLIER * variance
        share = 1.0 if square_mm2 <= usual_mm2 else math.sqrt(usual_mm2 / square_mm2)
        self._count = _FORGET * self._count + 1.0
        self._squares_mm2 = _FORGET * self._squares_mm2 + share * square_mm2
        self._row0 = _gathered(self._row0, fx, share * fx[0], fy, share * fy[0])
        self._row1 = _gathered(self._row1, fx, share * fx[1], fy, share * fy[1])
        self._row2 = _gathered(self._row2, fx, share * fx[2], fy, share * fy[2])
        self._row3 = _gathered(self._row3, fx, share * fx[3], fy, share * fy[3])
        self._row4 = _gathered(self._row4, fx, share * fx[4], fy, share * fy[4])
        right = self._right = _gathered(self._right, fx, share * dx_mm, fy, share * dy_mm)

        variance, start = self._squares_mm2 / self._count, self._start
        w = (_solved(w[0], 0, self._row0, self._prior0, right[0], variance, w, start), w[1], w[2], w[3], w[4])
        w = (w[0], _solved(w[1], 1, self._row1, self._prior1, right[1], variance, w, start), w[2], w[3], w[4])
        w = (w[0], w[1], _solved(w[2], 2, self._row2, self._prior2, right[2], variance, w, start), w[3], w[4])
        w = (w[0], w[1], w[2], _solved(w[3], 3, self._row3, self._prior3, right[3], variance, w, start), w[4])
        w = (w[0], w[1], w[2], w[3], _solved(w[4], 4, self._row4, self._prior4, right[4], variance, w, start))
        self.weights = w
        return ex, ey


class Spread:
    """The 68 % quantile of the error's size at one horizon, by class of speed: a scale for all, times one for each."""

    def __init__(self, by_class_mm: tuple[float, ...]) -> None:
        self._scale = 1.0
        self._by_class_mm = list(by_class_mm)
        self._errors = [0.0] * CLASSES

    def at(self, place: int) -> float:
        """Return the spread in mm of a class of speed. The lowest holds rest, where pads freeze: its own scale."""
        spread_mm = self._by_class_mm[place] * (self._scale if place > 0 else 1.0)
        return min(max(spread_mm, _LEAST_SPREAD_MM), _MOST_SPREAD_MM)

    def learn(self, place: int, error_mm: float) -> None:
        """Take an error in a class of speed."""
        excess = _SHARE_WITHIN if abs(error_mm) > self.at(place) else _SHARE_WITHIN - 1.0
        if place > 0:
            self._scale = min(max((1.0 + _STEP * excess) * self._scale, _LEAST_SCALE), _MOST_SCALE)
        self._errors[place] += 1.0
        step = max(_CLASS_STEP, 1.0 / (self._errors[place] + _CLASS_START))
        spread_mm = (1.0 + step * excess) * self._by_class_mm[place]
        self._by_class_mm[place] = min(max(spread_mm, _LEAST_SPREAD_MM), _MOST_SPREAD_MM)


class PadMemory:
    """What is learned of one pad, shared by the predictors of all its touches."""

    def __init__(self, near: MotionVector | None = None, far: MotionVector | None = None) -> None:
        """`near` and `far`: weights kept of this pad, at the two horizons."""
        self.near, self.far = HorizonFit(NEAR, near), HorizonFit(FAR, far)
        (near_along_mm, near_across_mm), (far_along_mm, far_across_mm) = SPREADS_MM
        self.near_along, self.near_across = Spread(near_along_mm), Spread(near_across_mm)
        self.far_along, self.far_across = Spread(far_along_mm), Spread(far_across_mm)

    @classmethod
    def of(cls, weights: Sequence[float]) -> PadMemory:
        """The memory that begins with those `kept` of this pad; with none, with the prior."""
        if len(weights) == 0:
            return cls()
        a, b, c, d, e, f, g, h, i, j = weights
        return cls((a, b, c, d, e), (f, g, h, i, j))

    @property
    def kept(self) -> tuple[float, ...]:
        """The weights at both horizons, one after the other."""
        return *self.near.weights, *self.far.weights

    def weights(self, ahead_s: float) -> MotionVector:
        """Return the weights at a horizon."""
        u = _between(ahead_s)
        a0, a1, a2, a3, a4 = self.near.weights
        b0, b1, b2, b3, b4 = self.far.weights
        return a0 + u * (b0 - a0), a1 + u * (b1 - a1), a2 + u * (b2 - a2), a3 + u * (b3 - a3), a4 + u * (b4 - a4)

    def spread_mm(self, ahead_s: float, place: int) -> tuple[float, float]:
        """Return the spread of the error along and across the motion at a horizon, in a class of speed."""
        u = _between(ahead_s)
        along_mm, across_mm = self.near_along.at(place), self.near_across.at(place)
        return (
            max(along_mm, along_mm + u * (self.far_along.at(place) - along_mm)),
            max(across_mm, across_mm + u * (self.far_across.at(place) - across_mm)),
        )


def speed_class(speed_mm_s: float) -> int:
    """Return the class of a speed: an octave."""
    place, edge_mm_s = 0, SLOWEST_MM_S
    while place < CLASSES - 1 and speed_mm_s > edge_mm_s:
        place += 1
        edge_mm_s *= 2.0
    return place


def _between(ahead_s: float) -> float:
    u = (ahead_s - NEAR_S) / (FAR_S - NEAR_S)
    return 0.0 if u < 0.0 else _FARTHEST_U if u > _FARTHEST_U else u


def dot(a: MotionVector, b: MotionVector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]


def _gathered(row: MotionVector, fx: MotionVector, x: float, fy: MotionVector, y: float) -> MotionVector:
    return (
        _FORGET * row[0] + fx[0] * x + fy[0] * y,
        _FORGET * row[1] + fx[1] * x + fy[1] * y,
        _FORGET * row[2] + fx[2] * x + fy[2] * y,
        _FORGET * row[3] + fx[3] * x + fy[3] * y,
        _FORGET * row[4] + fx[4] * x + fy[4] * y,
    )


def _solved(
    weight: float,
    index: int,
    row: MotionVector,
    prior: MotionVector,
    right: float,
    variance: float,
    w: MotionVector,
    start: MotionVector,
) -> float:
    """Return the weight that solves its own equation, the others as they are."""
    misfit = right - dot(row, w) + variance * (dot(prior, start) - dot(prior, w))
    solved = weight + misfit / (_at(row, index) + variance * _at(prior, index))
    return -MOST_WEIGHT if solved < -MOST_WEIGHT else MOST_WEIGHT if solved > MOST_WEIGHT else solved


def _at(vector: MotionVector, index: int) -> float:
    if index == 0:
        return vector[0]
    if index == 1:
        return vector[1]
    if index == 2:
        return vector[2]
    return vector[3] if index == 3 else vector[4]
