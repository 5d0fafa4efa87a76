"""Quadratic extrapolation, shared by the baseline motion models."""

from __future__ import annotations

import math

from ...core.prediction.bank import MAX_ACCELERATION_MM_S2, MAX_SPEED_MM_S, shortened
from ...core.prediction.motion import Sample


class QuadraticMotion:
    """Extrapolation by position, velocity and acceleration; unknown (NaN) until the first sample."""

    __slots__ = ("_ax", "_ay", "_vx", "_vy", "_x", "_y")

    def __init__(self) -> None:
        self._x = self._y = self._vx = self._vy = self._ax = self._ay = math.nan

    def start(self, x_mm: float, y_mm: float) -> None:
        """The first sample of a touch; whatever came before is forgotten."""
        raise NotImplementedError

    def step(self, sample: Sample) -> None:
        """Take the next sample."""
        raise NotImplementedError

    def _move(self, x: float, y: float, vx: float, vy: float, ax: float = 0.0, ay: float = 0.0) -> None:
        self._x, self._y = x, y
        self._vx, self._vy = vx, vy
        self._ax, self._ay = ax, ay
        if not (vx * vx + vy * vy <= MAX_SPEED_MM_S**2 and ax * ax + ay * ay <= MAX_ACCELERATION_MM_S2**2):
            self._vx, self._vy = shortened(vx, vy, MAX_SPEED_MM_S)
            self._ax, self._ay = shortened(ax, ay, MAX_ACCELERATION_MM_S2)

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
