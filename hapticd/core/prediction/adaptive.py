"""The default motion model: a bank of filters, corrected by what the pad's own touches teach.

The bank (`bank`) describes how fingers move; its assumption of white noise holds for no real pad, whose firmware
filters, holds and quantises. So its extrapolation is corrected by five terms whose weights are learned from the pad's
later reports (`pad_memory`), with a prior from many devices.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from ..touch.fingers import FingerPredictor
from ..touch.sensor_clock import GAP_PERIODS, SHORTEST_PERIODS
from .bank import ModelBank, shortened
from .motion import MotionModel, Sample
from .pad_memory import FAR_S, NEAR_S, HorizonFit, PadMemory, Spread, dot, speed_class
from .prior import MotionVector

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
_SLOPE_S: Final = 0.001

LONGEST_HORIZON_S: Final = 0.050  # a longer horizon is cut to this
_FARTHEST_MM: Final = 1e6  # a coordinate beyond is no position on any plate
_STALE_STEP_MM: Final = 0.3  # a finger that made such a step cannot be at exactly the same counts one sample later


class SlowFilter:
    """Kalman filter: velocity disturbed by white acceleration, both axes alike."""

    def __init__(self) -> None:
        self.start(math.nan, math.nan)

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch."""
        self.x, self.y, self.vx, self.vy = x_mm, y_mm, 0.0, 0.0
        self._xx, self._xv, self._vv = _SLOW_NOISE_MM2, 0.0, _SLOW_START_MM2_S2

    def step(self, d: float, x_mm: float, y_mm: float) -> None:
        """Take the sample `d` seconds after the last."""
        q = _SLOW_DENSITY_MM2_S3 * d
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


class AdaptiveMotion(MotionModel):
    """`period_ms` is the nominal sample period, `noise_mm` the standard error of one position on one axis that the bank
    assumes. `memory` holds what is learned of the pad; without one it begins with the touch.

    The first model of a given (period, noise) computes gain tables; later ones share them.
    """

    def __init__(self, *, period_ms: float, noise_mm: float = 0.053, memory: PadMemory | None = None) -> None:
        self._bank = ModelBank(period_ms=period_ms, noise_mm=noise_mm)
        self._memory = PadMemory() if memory is None else memory
        self._slow = SlowFilter()
        self._near: deque[Estimate] = deque()
        self._far: deque[Estimate] = deque()
        self._last = math.nan, math.nan
        self._settle(0.0)

    @property
    def estimate(self) -> Estimate:
        """The motion at the last sample."""
        return self._estimate

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

    def step(self, sample: Sample) -> None:
        """Take the next sample; learn from the predictions whose horizon it passes."""
        t_s = self._t_s + sample.interval_s
        memory = self._memory
        self._learn(self._near, NEAR_S, memory.near, (memory.near_along, memory.near_across), t_s, sample)
        self._learn(self._far, FAR_S, memory.far, (memory.far_along, memory.far_across), t_s, sample)
        self._bank.step(sample)
        self._slow.step(sample.interval_s, sample.x_mm, sample.y_mm)
        self._last = sample.x_mm, sample.y_mm
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

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        """Velocity in mm/s at the same instant: the slope of the position over 2 ms."""
        x0, y0 = self.position(ahead_s - _SLOPE_S)
        x1, y1 = self.position(ahead_s + _SLOPE_S)
        return (x1 - x0) / (2.0 * _SLOPE_S), (y1 - y0) / (2.0 * _SLOPE_S)

    def covariance(self, ahead_s: float) -> tuple[float, float, float]:
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
        self,
        waiting: deque[Estimate],
        ahead_s: float,
        fit: HorizonFit,
        spreads: tuple[Spread, Spread],
        t_s: float,
        sample: Sample,
    ) -> None:
        """Compare the predictions whose horizon lies between the last sample and this one with the line between."""
        while len(waiting) > 0 and waiting[0].t_s + ahead_s <= t_s:
            then = waiting.popleft()
            left = (t_s - then.t_s - ahead_s) / sample.interval_s
            dx_mm = sample.x_mm + left * (self._last[0] - sample.x_mm) - then.x - ahead_s * then.vx
            dy_mm = sample.y_mm + left * (self._last[1] - sample.y_mm) - then.y - ahead_s * then.vy
            if dx_mm * dx_mm + dy_mm * dy_mm > _JUMP_MM * _JUMP_MM:
                continue
            along_x, along_y = then.corrections(ahead_s)
            ex_mm, ey_mm = fit.learn(along_x, along_y, dx_mm, dy_mm)
            cos, sin = then.direction()
            place = then.speed_class()
            spreads[0].learn(place, cos * ex_mm + sin * ey_mm)
            spreads[1].learn(place, cos * ey_mm - sin * ex_mm)


class TouchPredictor(FingerPredictor):
    """One touch's predictor for samples whose stamps are filtered already.

    `update` takes a sample: when it was taken (`t_ns`, on the axis of `predict`), its filtered stamp (on the sampler's
    own axis: intervals come from it), its position, and the sampler's period. `predict` and `velocity` give position
    (mm) and velocity (mm/s) at an instant: NaN before the first sample, finite from then on. Instants up to the last
    sample give the filtered last position; horizons are cut at `LONGEST_HORIZON_S`.
    """

    def __init__(self, model: MotionModel) -> None:
        self._model = model
        self.reset()

    def reset(self) -> None:
        """Drop all samples."""
        self._t_ns: int | None = None
        self._t_stamp_ns = 0
        self._x_mm = self._y_mm = math.nan
        self._moved = False

    def update(self, t_ns: int, t_stamp_ns: int, x_mm: float, y_mm: float, period_s: float) -> None:
        """Take a sample. Ignored: what is no position, and stamps that do not increase."""
        if not is_position(x_mm, y_mm):
            return
        elapsed_s = math.inf if self._t_ns is None else (t_stamp_ns - self._t_stamp_ns) * 1e-9
        if elapsed_s > GAP_PERIODS * period_s:
            self._model.start(x_mm, y_mm)
            self._moved = False
        else:
            if elapsed_s <= 0.0 or self.is_stale(x_mm, y_mm):
                return
            self._model.step(Sample(max(elapsed_s, SHORTEST_PERIODS * period_s), period_s, x_mm, y_mm))
            dx_mm, dy_mm = x_mm - self._x_mm, y_mm - self._y_mm
            self._moved = dx_mm * dx_mm + dy_mm * dy_mm > _STALE_STEP_MM * _STALE_STEP_MM
        self._t_ns, self._t_stamp_ns = t_ns, t_stamp_ns
        self._x_mm, self._y_mm = x_mm, y_mm

    def predict(self, t_ns: int) -> tuple[float, float]:
        """Return the position in mm at `t_ns`."""
        return self._model.position(self._ahead_s(t_ns))

    def velocity(self, t_ns: int) -> tuple[float, float]:
        """Return the velocity in mm/s at `t_ns`."""
        return self._model.velocity(self._ahead_s(t_ns))

    def covariance(self, t_ns: int) -> tuple[float, float, float]:
        """Return xx, xy, yy in mm^2 of the predicted position's error at `t_ns`."""
        return self._model.covariance(self._ahead_s(t_ns))

    def is_stale(self, x_mm: float, y_mm: float) -> bool:
        """Return whether a moving finger's sample repeats the last one exactly. A second one in a row is not stale: the
        finger has stopped."""
        repeats = self._moved and x_mm == self._x_mm and y_mm == self._y_mm
        self._moved = self._moved and not repeats
        return repeats

    def _ahead_s(self, t_ns: int) -> float:
        if self._t_ns is None:
            return math.nan
        ahead_s = (t_ns - self._t_ns) * 1e-9
        if ahead_s <= 0.0:
            return 0.0
        return ahead_s if ahead_s <= LONGEST_HORIZON_S else LONGEST_HORIZON_S


def is_position(x_mm: float, y_mm: float) -> bool:
    """Return whether both are finite, and on some plate."""
    return -_FARTHEST_MM <= x_mm <= _FARTHEST_MM and -_FARTHEST_MM <= y_mm <= _FARTHEST_MM
