"""Motion models: the interface between a predictor's intake and the filter that estimates the motion."""

from __future__ import annotations

import math
from typing import NamedTuple

from mypy_extensions import mypyc_attr


class Sample(NamedTuple):
    """A position, the time since the previous one (> 0), and the period of the sampler."""

    interval_s: float
    period_s: float
    x_mm: float
    y_mm: float


@mypyc_attr(allow_interpreted_subclasses=True)  # a base class: native calls cost a tenth of a protocol's
class MotionModel:
    """A filter for one touch: takes samples at their true sampling times, extrapolates position and velocity."""

    def start(self, x_mm: float, y_mm: float) -> None:
        """Take the first sample of a touch; earlier ones are dropped."""
        raise NotImplementedError

    def step(self, sample: Sample) -> None:
        """Take the next sample."""
        raise NotImplementedError

    def position(self, ahead_s: float) -> tuple[float, float]:
        """Position in mm, `ahead_s` >= 0 after the last sample."""
        raise NotImplementedError

    def velocity(self, ahead_s: float) -> tuple[float, float]:
        """Velocity in mm/s at the same instant."""
        raise NotImplementedError

    def covariance(self, ahead_s: float) -> tuple[float, float, float]:
        """Expected xx, xy, yy (mm^2) of the position's error; NaN for a model that does not know."""
        return math.nan * ahead_s, math.nan, math.nan


def checked(name: str, value: float, low: float, high: float) -> float:
    """Return `value` if it lies in [low, high]; raises ValueError otherwise, NaN included."""
    if not low <= value <= high:
        raise ValueError(f"Predictor setting {name} is {value!r}: give a number from {low:g} to {high:g}.")
    return value
