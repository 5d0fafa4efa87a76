"""Paths of simulated fingers: pure functions of time.

A path gives `position_mm(t_s (T,)) -> (T, 2)`, NaN where the finger is lifted. Times are seconds from the run's start.
The same path gives the same positions in any order of calls. `Strokes` is the usual path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...values import FloatArray
from .strokes import Strokes, tremor_mm

TURNAROUND_S = 0.1
_Point = tuple[float, float]


class Path(Protocol):
    """The motion of one finger."""

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2) at times (T,); NaN where the finger is lifted."""


@dataclass(frozen=True)
class Rest:
    """A finger at rest at a point, with a tremor of `tremor_mm` on each axis."""

    point_mm: _Point
    tremor_mm: float = 0.0
    seed: int = 0

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        return np.asarray(self.point_mm) + tremor_mm(t_s, self.tremor_mm, self.seed)


@dataclass(frozen=True)
class Line:
    """Back and forth between two points at a constant speed, turning in TURNAROUND_S as a half cosine of speed.

    The points are the extremes; time 0 is the middle of the turn at `start_mm`. Raises ValueError if the two turns do
    not fit between them.
    """

    start_mm: _Point
    end_mm: _Point
    speed_mm_s: float = 100.0

    def __post_init__(self) -> None:
        needed_mm = 2 * self._turn_mm
        if not needed_mm < math.dist(self.start_mm, self.end_mm) < math.inf:
            raise ValueError(f"the points of a line must be more than {needed_mm:.3g} mm apart for the finger to turn")

    @property
    def _turn_mm(self) -> float:
        """Length of a half turn."""
        return self.speed_mm_s * TURNAROUND_S / math.pi

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        length_mm = math.dist(self.start_mm, self.end_mm)
        pass_s = (length_mm - 2 * self._turn_mm) / self.speed_mm_s + TURNAROUND_S
        phase_s = np.mod(t_s, 2 * pass_s)
        since_turn_s = np.minimum(phase_s, 2 * pass_s - phase_s)
        is_nearer_start = since_turn_s < pass_s / 2
        from_end_mm = self._leave_turn_mm(np.where(is_nearer_start, since_turn_s, pass_s - since_turn_s))
        distance_mm = np.where(is_nearer_start, from_end_mm, length_mm - from_end_mm)
        return _between(self.start_mm, self.end_mm, distance_mm / length_mm)

    def _leave_turn_mm(self, t_s: FloatArray) -> FloatArray:
        """Distance from the middle of a turn."""
        half_s = TURNAROUND_S / 2
        turned = np.minimum(t_s / half_s, 1.0)
        return self._turn_mm * (1 - np.cos(turned * math.pi / 2)) + self.speed_mm_s * np.maximum(t_s - half_s, 0.0)


@dataclass(frozen=True)
class ReachPath:
    """Minimum-jerk reaches between two points and back, `duration_s` each, with a rest of `hold_s` after each.

    The quintic of Flash and Hogan, J. Neurosci. 5 (1985): the peak speed is 1.875 times the mean.
    """

    start_mm: _Point
    end_mm: _Point
    duration_s: float = 0.45
    hold_s: float = 0.3

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        cycle_s = self.duration_s + self.hold_s
        phase_s = np.mod(t_s, 2 * cycle_s)
        is_return = phase_s >= cycle_s
        part = np.minimum(np.where(is_return, phase_s - cycle_s, phase_s) / self.duration_s, 1.0)
        way = part**3 * (10 - part * (15 - 6 * part))
        return _between(self.start_mm, self.end_mm, np.where(is_return, 1 - way, way))


@dataclass(frozen=True)
class CirclePath:
    """A circle at constant speed, anticlockwise; clockwise for a negative speed."""

    centre_mm: _Point
    radius_mm: float
    speed_mm_s: float = 100.0
    start_rad: float = 0.0

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        angle_rad = self.start_rad + np.asarray(t_s) * (self.speed_mm_s / self.radius_mm)
        return np.asarray(self.centre_mm) + self.radius_mm * np.stack((np.cos(angle_rad), np.sin(angle_rad)), axis=-1)


@dataclass(frozen=True)
class Touch:
    """A path that touches the plate from `down_s` until, not including, `up_s`."""

    path: Path
    down_s: float = 0.0
    up_s: float = math.inf

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        t_s = np.asarray(t_s, dtype=np.float64)
        is_down = (self.down_s <= t_s) & (t_s < self.up_s)
        return np.where(is_down[:, np.newaxis], self.path.position_mm(t_s), np.nan)


@dataclass(frozen=True)
class Touches:
    """One finger that lands several times; where touches overlap, the first counts."""

    touches: tuple[Path, ...]

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        positions = np.full((len(t_s), 2), np.nan)
        for touch in self.touches:
            positions = np.where(np.isnan(positions), touch.position_mm(t_s), positions)
        return positions


def with_strokes(path: Path, change: Callable[[Strokes, float], Path], down_s: float = 0.0) -> Path:
    """Return a path with its strokes changed, which land at the given instant; a path without any stays."""
    if isinstance(path, Strokes):
        return change(path, down_s)
    if isinstance(path, Touch):
        return replace(path, path=with_strokes(path.path, change, path.down_s))
    if isinstance(path, Touches):
        return Touches(tuple([with_strokes(touch, change) for touch in path.touches]))
    return path


def _between(start_mm: _Point, end_mm: _Point, part: FloatArray) -> FloatArray:
    start: FloatArray = np.asarray(start_mm, dtype=np.float64)
    return start + part[:, np.newaxis] * (np.asarray(end_mm) - start)
