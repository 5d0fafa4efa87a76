"""Random straight strokes over the plate, as of a person who explores a surface.

Speed ramps of 0.3 s give an 80 mm stroke the peak acceleration of a minimum-jerk reach of the same length and duration
(Flash and Hogan, J. Neurosci. 5, 1985), the usual motion of an unobstructed hand. The tremor of some 0.04 mm at
8 to 9 Hz is physiological (Elble and Koller, "Tremor", 1990).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...values import FloatArray

_TREMOR_HZ = (8.0, 9.0)
_WOBBLE_HZ = 2.0
_WOBBLE_MM = 0.4
_MOST_PAUSE_S = 0.05
_MIN_STROKE_MM = 55.0
HALF_SIZE_MM = 58.0
TREMOR_MM = 0.02
GAP_MM = 18.0
_REACH_MM = HALF_SIZE_MM - _WOBBLE_MM - TREMOR_MM  # of a stroke's end: keeps wobble and tremor inside
_CANDIDATES = 32
_FIRST_DRAWN_S = 10.0  # drawing more than a run needs would cost as much as the run


@dataclass(frozen=True)
class Strokes:
    """Endless straight strokes between random points within +-HALF_SIZE_MM of the centre.

    Speed rises to `speed_mm_s` and falls again along raised cosines of `ramp_s`; after a stroke the finger waits up
    to _MOST_PAUSE_S. It wobbles sideways, in proportion to its speed, and has a tremor. With `avoid`, strokes are
    chosen that keep GAP_MM from that finger where possible.
    """

    seed: int
    speed_mm_s: float = 100.0
    ramp_s: float = 0.3
    avoid: Strokes | None = None

    @cached_property
    def _wobble_phase_rad(self) -> float:
        return float(np.random.default_rng([self.seed, 2]).uniform(0, 2 * math.pi))

    @cached_property
    def _table(self) -> _StrokeTable:
        return _StrokeTable(self)

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        t_s = np.asarray(t_s, dtype=np.float64)
        if not np.all(np.isfinite(t_s)):
            raise ValueError("strokes are defined for finite times only")
        stroke = self._table.at(t_s)
        part, speed_frac = _progress(t_s - stroke.t_begin_s, stroke, self.ramp_s)
        wobble_mm = _WOBBLE_MM * (stroke.speed_mm_s / self.speed_mm_s) * speed_frac
        sideways_mm = wobble_mm * np.sin(2 * math.pi * _WOBBLE_HZ * t_s + self._wobble_phase_rad)
        x_mm = stroke.x_mm + part * stroke.dx_mm - sideways_mm * stroke.dy_mm / stroke.length_mm
        y_mm = stroke.y_mm + part * stroke.dy_mm + sideways_mm * stroke.dx_mm / stroke.length_mm
        return np.stack((x_mm, y_mm), axis=-1) + tremor_mm(t_s, TREMOR_MM, self.seed)


def strokes_pair(seed: int, *, speed_mm_s: float = 100.0) -> tuple[Strokes, Strokes]:
    """Two fingers on independent strokes; the second avoids the first where possible."""
    first = Strokes(2 * seed, speed_mm_s)
    return first, Strokes(2 * seed + 1, speed_mm_s, avoid=first)


class _Stroke(NamedTuple):
    """Strokes, one per element; the next one starts at `t_next_s`, after a pause."""

    t_begin_s: FloatArray
    x_mm: FloatArray
    y_mm: FloatArray
    dx_mm: FloatArray
    dy_mm: FloatArray
    length_mm: FloatArray
    speed_mm_s: FloatArray
    t_next_s: FloatArray


class _StrokeTable:
    """Strokes drawn in order from the seed; later times extend the table."""

    def __init__(self, settings: Strokes) -> None:
        self._settings = settings
        self._rng = np.random.default_rng([settings.seed, 0])
        self._drawn: list[FloatArray] = []
        self._t_next_s = 0.0
        self._point_mm = self._first_point_mm()
        self._draw_until(_FIRST_DRAWN_S)

    def at(self, t_s: FloatArray) -> _Stroke:
        """Return the stroke at each time; before time 0 the first."""
        latest_s = float(np.max(t_s, initial=0.0))
        if latest_s >= self._t_next_s:
            self._draw_until(1.5 * latest_s)
        which = np.searchsorted(self._columns[0], t_s, side="right") - 1
        return _Stroke(*self._columns[:, np.maximum(which, 0)])

    def _draw_until(self, t_s: float) -> None:
        while self._t_next_s <= t_s:
            stroke = self._draw()
            self._drawn.append(stroke)
            self._point_mm = stroke[1:3] + stroke[3:5]
            self._t_next_s = float(stroke[-1])
        self._columns = np.array(self._drawn).T

    def _draw(self) -> FloatArray:
        """Draw the next stroke: the first of _CANDIDATES that keeps its distance, or the one that keeps most."""
        if self._settings.avoid is None:
            return self._random_stroke()
        widest, widest_mm = self._random_stroke(), -1.0
        for _ in range(_CANDIDATES):
            stroke = self._random_stroke()
            clearance_mm = self._clearance_mm(_Stroke(*stroke[:, np.newaxis]), self._settings.avoid)
            if clearance_mm > widest_mm:
                widest, widest_mm = stroke, clearance_mm
            if clearance_mm >= GAP_MM:
                break
        return widest

    def _random_stroke(self) -> FloatArray:
        settings = self._settings
        delta_mm = np.zeros(2)
        while np.hypot(*delta_mm) < _MIN_STROKE_MM:
            delta_mm = self._random_point_mm() - self._point_mm
        length_mm = float(np.hypot(*delta_mm))
        speed_mm_s = min(settings.speed_mm_s, length_mm / settings.ramp_s)  # a short stroke is all ramps
        duration_s = length_mm / speed_mm_s + settings.ramp_s
        t_next_s = self._t_next_s + duration_s + self._rng.uniform(0, _MOST_PAUSE_S)
        return np.array((self._t_next_s, *self._point_mm, *delta_mm, length_mm, speed_mm_s, t_next_s))

    def _clearance_mm(self, stroke: _Stroke, other: Strokes) -> float:
        """Least distance between the other finger and a stroke with its pause, less wobble and tremor."""
        t_s = np.arange(float(stroke.t_begin_s[0]), float(stroke.t_next_s[0]), 0.01)
        part, _ = _progress(t_s - stroke.t_begin_s, stroke, self._settings.ramp_s)
        x_mm, y_mm = stroke.x_mm + part * stroke.dx_mm, stroke.y_mm + part * stroke.dy_mm
        distance_mm = np.hypot(*(other.position_mm(t_s) - np.stack((x_mm, y_mm), axis=-1)).T)
        return float(distance_mm.min()) - _WOBBLE_MM - math.sqrt(2) * TREMOR_MM

    def _first_point_mm(self) -> FloatArray:
        """Draw the start: of _CANDIDATES points the one farthest from the finger to avoid."""
        points_mm = [self._random_point_mm() for _ in range(_CANDIDATES)]
        if self._settings.avoid is None:
            return points_mm[0]
        (other_mm,) = self._settings.avoid.position_mm(np.zeros(1))
        return max(points_mm, key=lambda point_mm: math.dist(point_mm, other_mm))

    def _random_point_mm(self) -> FloatArray:
        return self._rng.uniform(-_REACH_MM, _REACH_MM, 2)


def _progress(t_s: FloatArray, stroke: _Stroke, ramp_s: float) -> tuple[FloatArray, FloatArray]:
    """Return share of a stroke's length covered, and share of its speed, at times since its start."""
    duration_s = stroke.length_mm / stroke.speed_mm_s + ramp_s
    t_s = np.clip(t_s, 0.0, duration_s)
    to_end_s = np.minimum(t_s, duration_s - t_s)  # of the nearer end: the stroke is symmetric in time
    ramp_rad = np.minimum(to_end_s / ramp_s, 1.0) * math.pi
    cruise_s = np.maximum(to_end_s - ramp_s, 0.0)
    delta_mm = stroke.speed_mm_s * (ramp_s / (2 * math.pi) * (ramp_rad - np.sin(ramp_rad)) + cruise_s)
    part = delta_mm / stroke.length_mm
    return np.where(t_s <= duration_s / 2, part, 1 - part), (1 - np.cos(ramp_rad)) / 2


def tremor_mm(t_s: FloatArray, amplitude_mm: float, seed: int) -> FloatArray:
    """Tremor (T, 2): on each axis a sine of its own frequency and phase."""
    rng = np.random.default_rng([seed, 1])
    frequency_hz, phase_rad = rng.uniform(*_TREMOR_HZ, 2), rng.uniform(0, 2 * math.pi, 2)
    tremor: FloatArray = amplitude_mm * np.sin(2 * math.pi * frequency_hz * np.asarray(t_s)[:, np.newaxis] + phase_rad)
    return tremor
