"""Baseline predictors by name, and the default: the same intake, another motion model.

Constants were fitted to slides, reaches, stops and strokes at 100 Hz with 0.05 mm of noise.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.prediction.bank import MAX_ACCELERATION_MM_S2, MAX_SPEED_MM_S, ModelBank, shortened
from ...core.prediction.gains import process_model, riccati_step, start_covariance
from ...core.prediction.motion import MotionModel, Sample, checked
from ...core.prediction.predictor import DEFAULT, Predictor, PredictorFactory
from ...sim.paper_scheme import HOLD
from ...values import FloatArray


class QuadraticMotion(MotionModel):
    """Extrapolation by position, velocity and acceleration; NaN before the first sample."""

    __slots__ = ("_ax", "_ay", "_vx", "_vy", "_x", "_y")

    def __init__(self) -> None:
        self._x = self._y = self._vx = self._vy = self._ax = self._ay = math.nan

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        self._set(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        """Take the next sample."""
        raise NotImplementedError

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample."""
        half = 0.5 * ahead_s
        return (
            self._x + ahead_s * (self._vx + half * self._ax),
            self._y + ahead_s * (self._vy + half * self._ay),
        )

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        """Velocity in mm/s at the same instant."""
        return self._vx + ahead_s * self._ax, self._vy + ahead_s * self._ay

    def _set(self, x: float, y: float, vx: float, vy: float, ax: float = 0.0, ay: float = 0.0) -> None:
        self._x, self._y = x, y
        self._vx, self._vy = shortened(vx, vy, MAX_SPEED_MM_S)
        self._ax, self._ay = shortened(ax, ay, MAX_ACCELERATION_MM_S2)


class Linear(QuadraticMotion):
    """A straight line through the last two samples."""

    __slots__ = ()

    def step(self, sample: Sample) -> None:
        interval_s, _, x_mm, y_mm = sample
        self._set(x_mm, y_mm, (x_mm - self._x) / interval_s, (y_mm - self._y) / interval_s)


class KalmanConstantVelocity(QuadraticMotion):
    """Kalman filter: velocity disturbed by white acceleration."""

    __slots__ = ("_acceleration_density", "_covariance", "_noise_mm")

    def __init__(self, *, acceleration_density_mm2_s3: float = 2.5e4, noise_mm: float = 0.07) -> None:
        super().__init__()
        self._acceleration_density = checked("acceleration_density_mm2_s3", acceleration_density_mm2_s3, 1e-3, 1e12)
        self._noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)

    def start(self, x_mm: float, y_mm: float) -> None:
        xx, vv = np.diag(start_covariance(self._noise_mm, 2)).tolist()
        self._covariance = xx, 0.0, vv
        super().start(x_mm, y_mm)

    def step(self, sample: Sample) -> None:
        d, _, x_mm, y_mm = sample
        q = self._acceleration_density * d
        xx, xv, vv = self._covariance
        xx += d * (2.0 * xv + d * (vv + q / 3.0))
        xv += d * (vv + q / 2.0)
        vv += q
        noise_mm2 = self._noise_mm * self._noise_mm
        spread = xx + noise_mm2
        k_x, k_v, left = xx / spread, xv / spread, noise_mm2 / spread
        self._covariance = left * xx, left * xv, vv - k_v * xv
        x, y = self._x + d * self._vx, self._y + d * self._vy
        ex, ey = x_mm - x, y_mm - y
        self._set(x + k_x * ex, y + k_x * ey, self._vx + k_v * ex, self._vy + k_v * ey)


class KalmanConstantJerk(QuadraticMotion):
    """Kalman filter: jerk disturbed by white snap; the share `damping` of the acceleration is extrapolated."""

    __slots__ = ("_covariance", "_damping", "_noise_mm", "_snap_density", "_state")

    def __init__(self, *, snap_density_mm2_s7: float = 3e9, noise_mm: float = 0.07, damping: float = 0.4) -> None:
        super().__init__()
        self._snap_density = checked("snap_density_mm2_s7", snap_density_mm2_s7, 1.0, 1e14)
        self._noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)
        self._damping = checked("damping", damping, 0.0, 1.0)

    def start(self, x_mm: float, y_mm: float) -> None:
        self._covariance = start_covariance(self._noise_mm, 4)
        self._state: FloatArray = np.zeros((4, 2))
        self._state[0] = x_mm, y_mm
        super().start(x_mm, y_mm)

    def step(self, sample: Sample) -> None:
        transition, process = process_model(sample.interval_s, self._snap_density, 4)
        self._covariance, gain, _ = riccati_step(self._covariance, transition, process, self._noise_mm**2)
        ahead = transition @ self._state
        self._state = ahead + gain[:, None] * ((sample.x_mm, sample.y_mm) - ahead[0])
        (x, y), (vx, vy), (ax, ay), _ = self._state.tolist()
        self._set(x, y, vx, vy, self._damping * ax, self._damping * ay)


PREDICTORS: dict[str, PredictorFactory] = {
    "default": DEFAULT,
    "bank": PredictorFactory.of(ModelBank),
    "hold": HOLD,
    "linear": PredictorFactory.of(Linear),
    "kalman_cv": PredictorFactory.of(KalmanConstantVelocity),
    "kalman_jerk": PredictorFactory.of(KalmanConstantJerk),
}


def make_predictor(name: str = "default", **settings: float) -> Predictor:
    """Return a predictor for one touch by name; ValueError names what is valid."""
    factory = PREDICTORS.get(name)
    if factory is None:
        raise ValueError(f"Unknown predictor {name!r}: choose from {', '.join(sorted(PREDICTORS))}.")
    return factory(memory=None, **settings)
