"""Motion models: the interface between a predictor's intake and the filter that estimates the motion."""

from __future__ import annotations

from typing import NamedTuple, Protocol


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


def checked(name: str, value: float, low: float, high: float) -> float:
    """`value` as a float if it lies in [low, high]; ValueError with one sentence otherwise (NaN included)."""
    if not low <= value <= high:
        raise ValueError(f"Predictor setting {name} is {value!r}: give a number from {low:g} to {high:g}.")
    return value
