"""The default predictor: a bank of Kalman filters, corrected by what the pad's own touches teach.

One filter of the bank assumes rest (a random walk), three constant acceleration disturbed by white jerk, three constant
jerk disturbed by white snap. Their densities (`gains.MODELS`) are so far apart that one of them fits rest, straight
slides, changes of speed and stops; the models of constant jerk fit arcs and sines. Weights follow the
interacting-multiple-model recursion (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988) with two
simplifications that save the matrix arithmetic and cost no accuracy on the bench: covariances are not mixed, so the
gains are those of the single filters and precomputed; both axes share gains and weights.

The bank's assumption of white noise holds for no real pad, whose firmware filters, holds and quantises. So its
extrapolation is corrected by five terms whose weights are learned from the pad's later reports (`pad_memory`), with a
prior from many devices.

The arithmetic is written out on floats: at this size numpy's time is the overhead of its calls.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from ..touch.fingers import FingerPredictor
from .gains import MODELS, STEPS, Gain, bank_gains
from .pad_memory import HorizonFit, MotionVector, PadMemory, dot, speed_class

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

# The slow filter: constant velocity disturbed by white acceleration, a hundredth of a hand's.
_SLOW_DENSITY_MM2_S3: Final = 2.5e3
_SLOW_NOISE_MM2: Final = 0.07**2
_SLOW_START_MM2_S2: Final = 1e4  # variance of a landing finger's velocity

# An acceleration that would change the way by more is an outlier's, not a finger's.
_ACCELERATED_SHARE: Final = 0.7
_ACCELERATED_MM: Final = 0.2
# Farther apart than fingers bring them: a jump of the contact, which is followed as a landing is and teaches nothing.
_JUMP_MM: Final = 20.0
_JUMP_MM_S: Final = 2e3
_MOST_CORRECTION_MM: Final = 5.0  # and as much as the finger moves by itself

_FIRST_SAMPLES: Final = 3  # of a touch: their predictions say more about landing than about the pad
_LEAST_APART_S: Final = 0.004  # of the predictions that teach: faster pads would forget faster


class ModelBank:
    """The bank of filters."""

    def __init__(self, period_ms: float, noise_mm: float) -> None:
        self._x = self._y = self._vx = self._vy = self._ax = self._ay = math.nan
        self._period_s = 1e-3 * period_ms
        intervals_s = tuple(
            self._period_s * 2.0 ** (index / _INTERVALS_PER_OCTAVE)
            for index in range(_SHORTEST_INDEX, _LONGEST_INDEX + 1)
        )
        self._gains: Final = bank_gains(intervals_s, noise_mm)
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

    def step(self, interval_s: float, x_mm: float, y_mm: float) -> None:
        """Take the next sample."""
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


def shortened(x: float, y: float, longest: float) -> tuple[float, float]:
    """(x, y) scaled to a length of at most `longest`."""
    length = math.hypot(x, y)
    return (x, y) if length <= longest else (x * (longest / length), y * (longest / length))


class SlowFilter:
    """Kalman filter: velocity disturbed by white acceleration, both axes alike."""

    def __init__(self, density_mm2_s3: float) -> None:
        self._density_mm2_s3: Final = density_mm2_s3
        self.start(math.nan, math.nan)

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch."""
        self.x, self.y, self.vx, self.vy = x_mm, y_mm, 0.0, 0.0
        self._xx, self._xv, self._vv = _SLOW_NOISE_MM2, 0.0, _SLOW_START_MM2_S2

    def step(self, d: float, x_mm: float, y_mm: float) -> None:
        """Take the sample `d` seconds after the last."""
        q = self._density_mm2_s3 * d
        xx = self._xx + d * (2.0 * self._xv + d * (self._vv + q / 3.0))
        xv = self._xv + d * (self._vv + q / 2.0)
        vv = self._vv + q
        spread = xx + _SLOW_NOISE_MM2
        k_x, k_v, left = xx / spread, xv / spread, _SLOW_NOISE_MM2 / spread
        self._xx, self._xv, self._vv = left * xx, left * xv, vv - k_v * xv
        x, y = self.x + d * self.vx, self.y + d * self.vy
        ex, ey = x_mm - x, y_mm - y
        self.x, self.y = x + k_x * ex, y + k_x * ey
        self.vx, self.vy = self.vx + k_v * ex, self.vy + k_v * ey


class Estimate:
    """The motion at a sample: position, velocity and acceleration of the bank, and what else corrections need."""

    def __init__(self, t_s: float, bank: ModelBank, last: tuple[float, float], slow: SlowFilter) -> None:
        """`t_s` from the touch's start, the `last` reported position, and the slow filter."""
        self.t_s = t_s
        self.x, self.y, self.vx, self.vy, self.ax, self.ay = bank.motion
        self.speed_mm_s = math.sqrt(self.vx * self.vx + self.vy * self.vy)
        self.usual_mm_s = math.sqrt(slow.vx * slow.vx + slow.vy * slow.vy)
        rx, ry, ox, oy = last[0] - self.x, last[1] - self.y, slow.x - self.x, slow.y - self.y
        cx, cy = slow.vx - self.vx, slow.vy - self.vy
        self.is_jump = max(rx * rx + ry * ry, ox * ox + oy * oy) > _JUMP_MM**2 or cx * cx + cy * cy > _JUMP_MM_S**2
        if self.is_jump:
            rx, ry = shortened(rx, ry, _JUMP_MM)
            ox, oy = shortened(ox, oy, _JUMP_MM)
            cx, cy = shortened(cx, cy, _JUMP_MM_S)
        self.rx, self.ry, self.ox, self.oy, self.cx, self.cy = rx, ry, ox, oy, cx, cy

    def speed_class(self) -> int:
        """Return the class of the speed now or usual, whichever is larger: a turn is no rest."""
        return speed_class(max(self.speed_mm_s, self.usual_mm_s))

    def direction(self) -> tuple[float, float]:
        """Return the unit vector of the motion; at rest that of x."""
        if self.speed_mm_s > 0.0:
            return self.vx / self.speed_mm_s, self.vy / self.speed_mm_s
        return 1.0, 0.0

    def corrections(self, ahead_s: float) -> tuple[MotionVector, MotionVector]:
        """Return the corrections at a horizon, in mm, on x and on y."""
        scale = 0.5 * ahead_s * ahead_s
        most_mm = _ACCELERATED_SHARE * ahead_s * self.speed_mm_s + _ACCELERATED_MM
        length_mm = scale * math.sqrt(self.ax * self.ax + self.ay * self.ay)
        if length_mm > most_mm:
            scale *= most_mm / length_mm
        return (
            (ahead_s * self.vx, scale * self.ax, self.rx, self.ox, ahead_s * self.cx),
            (ahead_s * self.vy, scale * self.ay, self.ry, self.oy, ahead_s * self.cy),
        )


class AdaptivePredictor(FingerPredictor):
    """The default predictor. `period_ms` is the nominal sample period, `noise_mm` the standard error of one position on
    one axis that the bank assumes. `memory` holds what is learned of the pad; without one it begins with the touch.

    The first model of a given (period, noise) computes gain tables; later ones share them.
    """

    def __init__(self, *, period_ms: float = 11.25, noise_mm: float = 0.053, memory: PadMemory | None = None) -> None:
        super().__init__()
        self._bank = ModelBank(period_ms, noise_mm)
        self._memory = PadMemory() if memory is None else memory
        self._slow = SlowFilter(_SLOW_DENSITY_MM2_S3)
        self._near: deque[Estimate] = deque()
        self._far: deque[Estimate] = deque()
        self._last = math.nan, math.nan
        self._settle(0.0)

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        self._bank.start(x_mm, y_mm)
        self._slow.start(x_mm, y_mm)
        self._near.clear()
        self._far.clear()
        self._samples = 1
        self._last = x_mm, y_mm
        self._t_taught_s = -math.inf
        self._settle(0.0)

    def step(self, interval_s: float, x_mm: float, y_mm: float) -> None:
        """Take the next sample; learn from the predictions whose horizon it passes."""
        t_s, place_mm = self._t_s + interval_s, (x_mm, y_mm)
        self._learn(self._near, self._memory.near, t_s, interval_s, place_mm)
        self._learn(self._far, self._memory.far, t_s, interval_s, place_mm)
        self._bank.step(interval_s, x_mm, y_mm)
        self._slow.step(interval_s, x_mm, y_mm)
        self._last = place_mm
        self._settle(t_s)
        self._samples += 1
        if self._estimate.is_jump:
            self._samples = 1
            self._near.clear()
            self._far.clear()
        elif self._samples > _FIRST_SAMPLES and t_s - self._t_taught_s > _LEAST_APART_S:
            self._t_taught_s = t_s
            self._near.append(self._estimate)
            self._far.append(self._estimate)

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample; NaN before the first."""
        now = self._estimate
        along_x, along_y = now.corrections(ahead_s)
        weights = self._memory.weights(ahead_s)
        dx_mm, dy_mm = dot(along_x, weights), dot(along_y, weights)
        most_mm = _MOST_CORRECTION_MM + ahead_s * now.speed_mm_s
        if dx_mm * dx_mm + dy_mm * dy_mm > most_mm * most_mm:
            dx_mm, dy_mm = shortened(dx_mm, dy_mm, most_mm)
        return now.x + ahead_s * now.vx + dx_mm, now.y + ahead_s * now.vy + dy_mm

    def covariance_mm2(self, ahead_s: float) -> tuple[float, float, float]:
        """Expected xx, xy, yy (mm^2) of the position's error: 68 % of the errors on an axis are within its root."""
        now = self._estimate
        along_mm, across_mm = self._memory.spread_mm(ahead_s, now.speed_class())
        along_mm2, across_mm2 = along_mm * along_mm, across_mm * across_mm
        cos, sin = now.direction()
        return (
            cos * cos * along_mm2 + sin * sin * across_mm2,
            cos * sin * (along_mm2 - across_mm2),
            sin * sin * along_mm2 + cos * cos * across_mm2,
        )

    def _settle(self, t_s: float) -> None:
        self._t_s = t_s
        self._estimate = Estimate(t_s, self._bank, self._last, self._slow)

    def _learn(
        self, waiting: deque[Estimate], fit: HorizonFit, t_s: float, interval_s: float, place_mm: tuple[float, float]
    ) -> None:
        """Compare the predictions whose horizon lies between the last sample and this one with the line between."""
        ahead_s = fit.ahead_s
        while len(waiting) > 0 and waiting[0].t_s + ahead_s <= t_s:
            then = waiting.popleft()
            left = (t_s - then.t_s - ahead_s) / interval_s
            dx_mm = place_mm[0] + left * (self._last[0] - place_mm[0]) - then.x - ahead_s * then.vx
            dy_mm = place_mm[1] + left * (self._last[1] - place_mm[1]) - then.y - ahead_s * then.vy
            if dx_mm * dx_mm + dy_mm * dy_mm > _JUMP_MM * _JUMP_MM:
                continue
            along_x, along_y = then.corrections(ahead_s)
            ex_mm, ey_mm = fit.learn(along_x, along_y, dx_mm, dy_mm)
            cos, sin = then.direction()
            place = then.speed_class()
            fit.along.learn(place, cos * ex_mm + sin * ey_mm)
            fit.across.learn(place, cos * ey_mm - sin * ex_mm)
