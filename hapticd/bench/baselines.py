"""Alternatives to the chosen parts: predictors, and rules for two points.

keep_zero      the core's own rule (`core.solver`)
keep_ratio     without limits, then all modes scaled into them: the fingers' ratios survive
least_squares  a still finger counts like any other: some leak there, less error elsewhere
paper          the inverse of Phi, signs fixed, scaled into the limits
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from ..core.prediction import Predictor
from ..core.prediction import make_predictor as make_default
from ..core.prediction.motion import MAX_SPEED_MM_S, SlowFilter, shortened
from ..core.solver import public
from ..core.touch.fingers import FingerPredictor
from ..sim.paper_scheme import SampleHold, invert
from ..values import Solution

POLICIES: Final = ("keep_zero", "keep_ratio", "least_squares", "paper")
_UNLIMITED_UM, _NEARLY_STILL_UM = 1e30, 1e-9
_ACCELERATION_DENSITY_MM2_S3: Final = 2.5e4  # of a hand


class Linear(FingerPredictor):
    """A straight line through the last two samples; NaN before the first."""

    def __init__(self) -> None:
        super().__init__()
        self._x = self._y = self._vx = self._vy = math.nan

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        self._set(x_mm, y_mm, 0.0, 0.0)

    def step(self, interval_s: float, x_mm: float, y_mm: float) -> None:
        """Take the next sample."""
        self._set(x_mm, y_mm, (x_mm - self._x) / interval_s, (y_mm - self._y) / interval_s)

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample."""
        return self._x + ahead_s * self._vx, self._y + ahead_s * self._vy

    def _set(self, x: float, y: float, vx: float, vy: float) -> None:
        self._x, self._y = x, y
        self._vx, self._vy = shortened(vx, vy, MAX_SPEED_MM_S)


class KalmanConstantVelocity(Linear):
    """Kalman filter: velocity disturbed by white acceleration."""

    def start(self, x_mm: float, y_mm: float) -> None:
        self._filter = SlowFilter(_ACCELERATION_DENSITY_MM2_S3)
        self._filter.start(x_mm, y_mm)
        super().start(x_mm, y_mm)

    def step(self, interval_s: float, x_mm: float, y_mm: float) -> None:
        self._filter.step(interval_s, x_mm, y_mm)
        self._set(self._filter.x, self._filter.y, self._filter.vx, self._filter.vy)


PREDICTORS: dict[str, Callable[[], Predictor]] = {
    "default": make_default,
    "hold": partial(Predictor, SampleHold),
    "linear": partial(Predictor, Linear),
    "kalman_cv": partial(Predictor, KalmanConstantVelocity),
}


def make_predictor(name: str = "default", **settings: float) -> Predictor:
    """Return a predictor for one touch by name; ValueError names what is valid."""
    if name not in PREDICTORS:
        raise ValueError(f"Unknown predictor {name!r}: choose from {', '.join(sorted(PREDICTORS))}.")
    return PREDICTORS[name](**settings)


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
