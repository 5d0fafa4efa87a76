"""Statistics of a pad, learned while it is touched: corrections of the bank, and the error of the result.

No model of the pad's noise is assumed. Each prediction is compared with what the pad reports once its horizon has
passed. Five corrections are weighted so that the sum of squared errors is least; they are

    0   the bank's velocity, times the horizon
    1   its acceleration, times half the horizon squared
    2   the last reported position less the bank's
    3   the position of a slow filter less the bank's
    4   its velocity less the bank's, times the horizon

For each of two horizons: recursive least squares that forget, in the information form, with a normal prior on the
weights: matrix A = sum f f^T, right side b = sum f d, and (A + s^2 L) w = b + s^2 L w0, where s^2 is the
residual's variance. One Gauss-Seidel sweep a sample follows the solution closely enough, as A changes slowly. The
weights of other horizons are on the straight line through the two.

The spread of the error along and across the motion is the 68 % quantile of its size, tracked in octaves of speed by
steps of a fixed ratio (Robbins and Monro, A Stochastic Approximation Method, Annals of Mathematical Statistics 22,
1951). It belongs to the positions that the pad reports, whose noise it includes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

MotionVector = tuple[float, float, float, float, float]

MOST_WEIGHT: Final = 8.0  # beyond three deviations of every prior

_FORGET: Final = 0.998  # per sample: 5 s
_START_SAMPLES: Final = 4.0  # for which the initial residual counts
_START_RESIDUAL_MM2: Final = 0.1  # typical of real pads; a smaller one would let a quiet start fix the weights
_OUTLIER: Final = 5.0  # deviations: an error beyond counts by its size, not its square (Huber 1964)
_NEAREST_U: Final = -0.5  # of the line through both horizons: 7.5 ms, for less is known of the last report alone
_FARTHEST_U: Final = 4.0 / 3.0  # 35 ms, the longest horizon of the loop

SLOWEST_MM_S: Final = 5.0  # upper edge of the lowest class of speed; each next one is an octave
CLASSES: Final = 9
_SHARE_WITHIN: Final = 0.6827
_STEP: Final = 0.1  # of the common scale, relative, per error
_CLASS_STEP: Final = 0.03  # of one class, once it has seen many; 1 / (errors + _CLASS_START) before
_CLASS_START: Final = 8.0
_LEAST_SPREAD_MM: Final = 1e-3
_MOST_SPREAD_MM: Final = 1e2
_LEAST_SCALE: Final = 0.1
_MOST_SCALE: Final = 10.0


# What is known before a pad is touched: the distribution of the weights over many devices. From public recordings of
# real touches: zhaorz/Touch-Calculator, whot/evemu-devices, bentiss/hid-devices, interactionlab/MobileHCI17-Touch-
# Extrapolation and others, 132 000 samples of 40 devices, and the synthetic motions of `bench/motions` as 18 devices
# more, so that a pad of white noise is not forgotten. For each device the normal equations of its corrections were
# summed as `HorizonFit` forms them; the prior is the normal distribution of the devices' weights, by expectation
# maximisation (empirical Bayes; Dempster, Laird, Rubin 1977), where 20 neighbouring samples count as one. The spreads
# are medians over the devices of 68 % quantiles.


class Prior(NamedTuple):
    """At one horizon: the weights' normal distribution, its mean and the inverse of its covariance by rows, and the
    spreads along and across the motion by class of speed."""

    ahead_s: float
    mean: MotionVector
    precision: tuple[MotionVector, MotionVector, MotionVector, MotionVector, MotionVector]
    along_mm: tuple[float, ...]
    across_mm: tuple[float, ...]


NEAR: Final = Prior(
    0.015,
    (-0.0338721, 0.100796, 1.36776, -0.47556, 0.521582),
    (
        (1072.3, 3.54525, 40.8981, 15.3229, -15.8362),
        (3.54525, 9.07174, 0.905827, 0.598389, -1.43149),
        (40.8981, 0.905827, 4.72699, 2.11084, -2.70726),
        (15.3229, 0.598389, 2.11084, 1.348, -0.78711),
        (-15.8362, -1.43149, -2.70726, -0.78711, 4.11951),
    ),
    (0.0226, 0.0756, 0.11, 0.16, 0.2, 0.313, 0.454, 0.64, 2.92),
    (0.00583, 0.0351, 0.05, 0.063, 0.0903, 0.114, 0.15, 0.164, 0.175),
)

FAR: Final = Prior(
    0.030,
    (-0.0509109, 0.182597, 2.26636, -1.55334, 0.536177),
    (
        (571.166, 7.74706, 18.6196, 7.6117, -0.502112),
        (7.74706, 21.4252, 1.89781, 1.55545, 1.52172),
        (18.6196, 1.89781, 1.61779, 0.818618, -0.03327),
        (7.6117, 1.55545, 0.818618, 0.524009, 0.286304),
        (-0.502112, 1.52172, -0.03327, 0.286304, 2.15345),
    ),
    (0.0541, 0.152, 0.245, 0.36, 0.439, 0.627, 0.901, 1.33, 5.84),
    (0.0133, 0.0608, 0.0938, 0.136, 0.203, 0.252, 0.322, 0.336, 0.421),
)


class HorizonFit:
    """Weights of the corrections at one horizon, and the spread of what they miss."""

    def __init__(self, prior: Prior, weights: MotionVector | None = None) -> None:
        """`weights` replaces the prior's mean: those that were kept of this pad."""
        self.ahead_s: Final = prior.ahead_s
        self.along, self.across = Spread(prior.along_mm), Spread(prior.across_mm)
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
        a, b, c, d, e = self._row0, self._row1, self._row2, self._row3, self._row4
        p, q, r, s, t = self._prior0, self._prior1, self._prior2, self._prior3, self._prior4
        w = (_solved(w, w[0], a, a[0] + variance * p[0], p, right[0], variance, start), w[1], w[2], w[3], w[4])
        w = (w[0], _solved(w, w[1], b, b[1] + variance * q[1], q, right[1], variance, start), w[2], w[3], w[4])
        w = (w[0], w[1], _solved(w, w[2], c, c[2] + variance * r[2], r, right[2], variance, start), w[3], w[4])
        w = (w[0], w[1], w[2], _solved(w, w[3], d, d[3] + variance * s[3], s, right[3], variance, start), w[4])
        w = (w[0], w[1], w[2], w[3], _solved(w, w[4], e, e[4] + variance * t[4], t, right[4], variance, start))
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
    """Statistics of one pad, shared by the predictors of all its touches."""

    def __init__(self, near: MotionVector | None = None, far: MotionVector | None = None) -> None:
        """`near` and `far`: weights kept of this pad, at the two horizons."""
        self.near, self.far = HorizonFit(NEAR, near), HorizonFit(FAR, far)

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
        along_mm, across_mm = self.near.along.at(place), self.near.across.at(place)
        return (
            max(along_mm, along_mm + u * (self.far.along.at(place) - along_mm)),
            max(across_mm, across_mm + u * (self.far.across.at(place) - across_mm)),
        )


def speed_class(speed_mm_s: float) -> int:
    """Return the class of a speed: an octave."""
    place, edge_mm_s = 0, SLOWEST_MM_S
    while place < CLASSES - 1 and speed_mm_s > edge_mm_s:
        place += 1
        edge_mm_s *= 2.0
    return place


def _between(ahead_s: float) -> float:
    u = (ahead_s - NEAR.ahead_s) / (FAR.ahead_s - NEAR.ahead_s)
    return _NEAREST_U if u < _NEAREST_U else _FARTHEST_U if u > _FARTHEST_U else u


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
    w: MotionVector,
    weight: float,
    row: MotionVector,
    diagonal: float,
    prior: MotionVector,
    right: float,
    variance: float,
    start: MotionVector,
) -> float:
    """Return the weight that solves its own equation, the others as they are."""
    misfit = right - dot(row, w) + variance * (dot(prior, start) - dot(prior, w))
    solved = weight + misfit / diagonal
    return -MOST_WEIGHT if solved < -MOST_WEIGHT else MOST_WEIGHT if solved > MOST_WEIGHT else solved
