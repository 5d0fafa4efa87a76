"""A bank of seven fixed-gain Kalman filters, weighted by their likelihoods.

One filter assumes rest (a random walk), three constant acceleration disturbed by white jerk, three constant jerk
disturbed by white snap. Their densities (`gains.MODELS`) are so far apart that one of them fits rest, straight slides,
changes of speed and stops; the models of constant jerk fit arcs and sines. Weights follow the
interacting-multiple-model recursion (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988) with two
simplifications that save the matrix arithmetic and cost no accuracy on the bench: covariances are not mixed, so the
gains are those of the single filters and precomputed; both axes share gains and weights.

The bank assumes white noise of a known level. What a pad's noise does to its extrapolation is corrected by
`adaptive`.

The arithmetic is written out on floats: at this size numpy's time is the overhead of its calls.
"""

from __future__ import annotations

import math
from typing import Final

from .gains import MODELS, STEPS, Gain, bank_gains
from .motion import MotionModel, Sample, checked

# No finger on a plate exceeds these; a model beyond them has taken a bad sample.
MAX_SPEED_MM_S: Final = 4e3
MAX_ACCELERATION_MM_S2: Final = 2e5

_STAY: Final = 0.994  # probability that a model that fits this sample fits the next
_SWITCH: Final = (1.0 - _STAY) / (len(MODELS) - 1)  # to each of the others
_STAMP_VAR_S2: Final = 0.2e-3**2  # jitter left in the filtered stamps: at speed it widens the expected innovation
_ACCELERATION_DAMPING: Final = 0.58  # share that is extrapolated, because fingers do not accelerate for long; fitted

# On an arc and in a sine the jerk opposes the velocity: j = -omega^2 v. A jerk along the velocity occurs where a motion
# starts or stops and is short; kept in full it would raise the overshoot of a reach from 0.10 to 0.15 mm.
_JERK_KEPT_ALONG: Final = 0.3  # from sample to sample

# Gains depend on the interval: with those for 11 ms the fastest filter is unstable at 22 ms (every other report lost).
# They are tabulated for intervals a quarter octave apart, from half a period to the longest gap; an interval an eighth
# of an octave off costs less than 1 % of accuracy.
_INTERVALS_PER_OCTAVE: Final = 4
_SHORTEST_INDEX: Final = -4
_LONGEST_INDEX: Final = 10

_State = tuple[float, float, float, float, float, float, float, float]  # x, y in mm, then velocity, acceleration, jerk


class ModelBank(MotionModel):
    """`period_ms` is the nominal sample period, `noise_mm` the standard error of one position on one axis.

    The first bank of a given (period, noise) computes its gain tables; later ones share them.
    """

    def __init__(self, *, period_ms: float, noise_mm: float = 0.053) -> None:
        self._x = self._y = self._vx = self._vy = self._ax = self._ay = math.nan
        self._period_s = 1e-3 * period_ms
        intervals_s = tuple(
            self._period_s * 2.0 ** (index / _INTERVALS_PER_OCTAVE)
            for index in range(_SHORTEST_INDEX, _LONGEST_INDEX + 1)
        )
        self._gains: Final = bank_gains(intervals_s, checked("noise_mm", noise_mm, 1e-4, 10.0))
        self._row, self._row_gains = (-1, -1), list[Gain]()  # the last of these that was read

    @property
    def motion(self) -> tuple[float, float, float, float, float, float]:
        """Position, velocity and undamped acceleration on x and y at the last sample; NaN before the first."""
        return self._x, self._y, self._vx, self._vy, self._ax / _ACCELERATION_DAMPING, self._ay / _ACCELERATION_DAMPING

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        still = (x_mm, y_mm, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._samples = 1
        self._filters = [_Filter(still, order) for order, _ in MODELS]
        self._settle(still)

    def step(self, sample: Sample) -> None:
        """Take the next sample."""
        interval_s, _, x_mm, y_mm = sample
        gains = self._gains_after(interval_s)
        self._samples += 1
        mean = self._mean
        for index, model in enumerate(self._filters):
            prior = _SWITCH + (_STAY - _SWITCH) * model.weight
            own_share = (_STAY - _SWITCH) * model.weight / prior
            model.follow(mean, own_share, gains[index], interval_s, x_mm, y_mm)
            model.weight = prior / model.spread
        _weigh(self._filters)
        self._settle(_weighted_mean(self._filters))

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample; NaN before the first."""
        half = 0.5 * ahead_s
        return (
            self._x + ahead_s * (self._vx + half * self._ax),
            self._y + ahead_s * (self._vy + half * self._ay),
        )

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        """Velocity in mm/s at the same instant."""
        return self._vx + ahead_s * self._ax, self._vy + ahead_s * self._ay

    def _gains_after(self, interval_s: float) -> list[Gain]:
        index = round(_INTERVALS_PER_OCTAVE * math.log2(interval_s / self._period_s))
        interval = min(max(index, _SHORTEST_INDEX), _LONGEST_INDEX) - _SHORTEST_INDEX
        row = min(self._samples, STEPS) - 1
        if (interval, row) != self._row:
            found: list[list[float]] = self._gains[interval, row].tolist()
            self._row, self._row_gains = (interval, row), [(k_x, k_v, k_a, k_j, s) for k_x, k_v, k_a, k_j, s in found]
        return self._row_gains

    def _settle(self, mean: _State) -> None:
        self._mean = mean
        x, y, vx, vy, full_ax, full_ay, _, _ = mean
        ax, ay = _ACCELERATION_DAMPING * full_ax, _ACCELERATION_DAMPING * full_ay
        self._x, self._y = x, y
        self._vx, self._vy = vx, vy
        self._ax, self._ay = ax, ay
        if not (vx * vx + vy * vy <= MAX_SPEED_MM_S**2 and ax * ax + ay * ay <= MAX_ACCELERATION_MM_S2**2):
            self._vx, self._vy = shortened(vx, vy, MAX_SPEED_MM_S)
            self._ax, self._ay = shortened(ax, ay, MAX_ACCELERATION_MM_S2)


def shortened(x: float, y: float, longest: float) -> tuple[float, float]:
    """(x, y) scaled to a length of at most `longest`."""
    length = math.hypot(x, y)
    return (x, y) if length <= longest else (x * (longest / length), y * (longest / length))


class _Filter:
    """A model of the bank with `order` states on each axis: 1 rests, 3 has constant acceleration, 4 constant jerk.

    `weight` is its probability; of the innovation at the last sample `misfit` is chi^2 / 2, `spread` the expected
    variance (mm^2) on one axis.
    """

    def __init__(self, state: _State, order: int) -> None:
        self.state = state
        self.weight = 1.0 / len(MODELS)
        self.misfit, self.spread = 0.0, 1.0
        self._order: Final = order

    def follow(self, mean: _State, own_share: float, gain: Gain, d: float, x_mm: float, y_mm: float) -> None:
        """Take a sample `d` seconds after the last: mix in the bank's mean, predict, correct."""
        half_d, third_d = 0.5 * d, d / 3.0
        x, y, vx, vy, ax, ay, jx, jy = self.state
        mean_x, mean_y, mean_vx, mean_vy, mean_ax, mean_ay, mean_jx, mean_jy = mean
        k_x, k_v, k_a, k_j, spread = gain
        if self._order == 1:
            vx = vy = ax = ay = jx = jy = 0.0
        else:
            ax = mean_ax + own_share * (ax - mean_ax)
            ay = mean_ay + own_share * (ay - mean_ay)
            vx = mean_vx + own_share * (vx - mean_vx)
            vy = mean_vy + own_share * (vy - mean_vy)
        if self._order == 4:
            jx = mean_jx + own_share * (jx - mean_jx)
            jy = mean_jy + own_share * (jy - mean_jy)
            if jx * vx + jy * vy > 0.0:
                jx *= _JERK_KEPT_ALONG
                jy *= _JERK_KEPT_ALONG
        x = mean_x + own_share * (x - mean_x) + d * (vx + half_d * (ax + third_d * jx))
        y = mean_y + own_share * (y - mean_y) + d * (vy + half_d * (ay + third_d * jy))
        vx += d * (ax + half_d * jx)
        vy += d * (ay + half_d * jy)
        ax += d * jx
        ay += d * jy

        ex, ey = x_mm - x, y_mm - y
        spread += 0.5 * _STAMP_VAR_S2 * (vx * vx + vy * vy)
        self.state = (
            x + k_x * ex, y + k_x * ey, vx + k_v * ex, vy + k_v * ey,
            ax + k_a * ex, ay + k_a * ey, jx + k_j * ex, jy + k_j * ey,
        )  # fmt: skip
        self.misfit, self.spread = (ex * ex + ey * ey) / (2.0 * spread), spread


def _weigh(filters: list[_Filter]) -> None:
    """Posterior weights: prior * exp(-misfit) / spread, normalised.

    The least misfit is subtracted first, so that not all weights underflow. A single one may: `_SWITCH` raises it again
    at the next sample.
    """
    best = math.inf
    for model in filters:
        best = min(best, model.misfit)
    total = 0.0
    for model in filters:
        model.weight *= math.exp(best - model.misfit)
        total += model.weight
    for model in filters:
        model.weight /= total


def _weighted_mean(filters: list[_Filter]) -> _State:
    x = y = vx = vy = ax = ay = jx = jy = 0.0
    for model in filters:
        weight = model.weight
        model_x, model_y, model_vx, model_vy, model_ax, model_ay, model_jx, model_jy = model.state
        x += weight * model_x
        y += weight * model_y
        vx += weight * model_vx
        vy += weight * model_vy
        ax += weight * model_ax
        ay += weight * model_ay
        jx += weight * model_jx
        jy += weight * model_jy
    return x, y, vx, vy, ax, ay, jx, jy
