"""What the chosen parts are measured against: predictors, and rules for two points.

keep_zero      the core's own rule (`core.solver`)
keep_ratio     without limits, then all modes scaled into them: the fingers' ratios survive
least_squares  a still finger counts like any other: some leak there, less error elsewhere
paper          the inverse of Phi, signs fixed, scaled into the limits
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from ..core.prediction.bank import MAX_SPEED_MM_S, ModelBank, shortened
from ..core.prediction.gains import start_covariance
from ..core.prediction.motion import MotionModel, Sample, checked
from ..core.prediction.predictor import DEFAULT, Predictor, PredictorFactory
from ..core.solver import public
from ..sim.paper_scheme import HOLD, invert
from ..values import Solution

POLICIES: Final = ("keep_zero", "keep_ratio", "least_squares", "paper")
_UNLIMITED_UM, _NEARLY_STILL_UM = 1e30, 1e-9


class Linear(MotionModel):
    """A straight line through the last two samples; NaN before the first."""

    __slots__ = ("_vx", "_vy", "_x", "_y")

    def __init__(self) -> None:
        self._x = self._y = self._vx = self._vy = math.nan

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        self._set(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        """Take the next sample."""
        interval_s, _, x_mm, y_mm = sample
        self._set(x_mm, y_mm, (x_mm - self._x) / interval_s, (y_mm - self._y) / interval_s)

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample."""
        return self._x + ahead_s * self._vx, self._y + ahead_s * self._vy

    def velocity(self, ahead_s: float) -> tuple[float, float]:  # noqa: ARG002
        """Velocity in mm/s."""
        return self._vx, self._vy

    def _set(self, x: float, y: float, vx: float, vy: float) -> None:
        self._x, self._y = x, y
        self._vx, self._vy = shortened(vx, vy, MAX_SPEED_MM_S)


class KalmanConstantVelocity(Linear):
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


PREDICTORS: dict[str, PredictorFactory] = {
    "default": DEFAULT,
    "bank": PredictorFactory.of(ModelBank),
    "hold": HOLD,
    "linear": PredictorFactory.of(Linear),
    "kalman_cv": PredictorFactory.of(KalmanConstantVelocity),
}


def make_predictor(name: str = "default", **settings: float) -> Predictor:
    """Return a predictor for one touch by name; ValueError names what is valid."""
    factory = PREDICTORS.get(name)
    if factory is None:
        raise ValueError(f"Unknown predictor {name!r}: choose from {', '.join(sorted(PREDICTORS))}.")
    return factory(memory=None, **settings)


def solve(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    previous_um: npt.ArrayLike | None = None,
) -> Solution:
    """As `core.solver.solve`, under one of the `POLICIES`. Raises ValueError for an unknown one, too."""
    if policy not in POLICIES:
        raise ValueError(f"policy: {policy!r} is unknown; choose one of {', '.join(POLICIES)}.")
    if policy == "keep_ratio":
        free = public.solve(phi, target_um, _UNLIMITED_UM, previous_um=previous_um)
        excess = max(float(np.max(np.abs(free.modal_um) / limit_um)), 1.0)
        modal_um = np.clip(free.modal_um / excess, -np.asarray(limit_um), limit_um)
        return Solution(modal_um, np.abs(np.asarray(phi) @ modal_um), excess > 1.0, free.condition)
    if policy == "least_squares" and np.any(target_um):
        target_um = np.maximum(target_um, _NEARLY_STILL_UM)
    found = public.solve(phi, target_um, limit_um, previous_um=previous_um)  # which checks the input
    if policy != "paper":
        return found
    shapes, limits = np.asarray(phi, np.float64), np.broadcast_to(np.asarray(limit_um, np.float64), len(found.modal_um))
    rows = tuple(map(tuple, shapes.tolist()))
    inverted_um, limited = invert(rows, tuple(np.asarray(target_um, np.float64).tolist()), tuple(limits.tolist()))
    return Solution(np.array(inverted_um), np.abs(shapes @ inverted_um), limited, found.condition)
