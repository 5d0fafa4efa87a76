"""What every model of a finger's motion can do, and the quadratic extrapolation that most of them share."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Protocol

# No finger on a plate is faster or changes speed faster than this; a model that says so has seen a bad sample.
MAX_SPEED_MM_S: Final = 4e3
MAX_ACCELERATION_MM_S2: Final = 2e5


class Sample(NamedTuple):
    """A position, the time since the one before it (> 0), and the period of the sampler that made both."""

    interval_s: float
    period_s: float
    x_mm: float
    y_mm: float


class MotionModel(Protocol):
    """A filter for one touch: samples in, at their true sampling times; position and velocity ahead of the last out."""

    def start(self, x_mm: float, y_mm: float) -> None:
        """The first sample of a touch; whatever came before is forgotten."""

    def step(self, sample: Sample) -> None:
        """Take the next sample."""

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample."""

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        """Velocity in mm/s at the same instant."""


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
            self._vx, self._vy = _shortened(vx, vy, MAX_SPEED_MM_S)
            self._ax, self._ay = _shortened(ax, ay, MAX_ACCELERATION_MM_S2)

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


def _shortened(x: float, y: float, longest: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    return (x, y) if length <= longest else (x * (longest / length), y * (longest / length))


def checked(name: str, value: float, low: float, high: float) -> float:
    """`value` as a float if it lies in [low, high]; ValueError with one sentence otherwise (NaN included)."""
    if not low <= value <= high:
        raise ValueError(f"Predictor setting {name} is {value!r}: give a number from {low:g} to {high:g}.")
    return value
