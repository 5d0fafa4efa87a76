"""Forms of effects as polylines in time: their value at an instant, and the corners where a reference needs knots.

A pulse and an envelope are polylines. A sine is drawn as one with SINE_CORNERS corners per period, scaled so that it
is as far outside of the cosine at its corners as it is inside in between: by (1 - cos(pi/n)) / (1 + cos(pi/n)) of the
half depth, 2.6 % of the depth for n = 7. A step takes a grain of the wire's time. All instants are whole grains, so
that a corner is a knot exactly.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Final

from hapticd_contract.effects import Envelope, Form, Modulation, Pulse

from ..trajectory.gate import GRAIN_NS

SINE_CORNERS: Final = 7  # six would be 3.6 % of the depth off
ENDLESS_NS: Final = 2**60
_OUTSET: Final = 2.0 / (1.0 + math.cos(math.pi / SINE_CORNERS))


class Course:
    """A form over the time since its beginning (ns). `is_factor`: it multiplies, and is 1 outside; else it adds, and
    is 0 outside. `length_ns` is ENDLESS_NS for one that something else ends."""

    def __init__(self, form: Form, loops: bool) -> None:
        is_factor = isinstance(form, Modulation) or (isinstance(form, Envelope) and form.is_factor)
        times_ns, values = _polyline(form)
        neutral = 1.0 if is_factor else 0.0
        is_wave = isinstance(form, Modulation)
        if not is_wave:
            _close(times_ns, values, values[0] if loops else neutral)
        length_ns = ENDLESS_NS
        if isinstance(form, Modulation):
            if not loops and form.length_s is not None:
                length_ns = max(_on_grid(form.length_s), 2 * GRAIN_NS)
        elif not loops:
            length_ns = times_ns[-1]
        self.is_factor: Final = is_factor
        self.length_ns: Final = length_ns
        self._neutral: Final = neutral
        self._times_ns: Final = times_ns
        self._values: Final = values
        self._period_ns: Final = times_ns[-1]
        self._is_cut: Final = is_wave and length_ns < ENDLESS_NS
        self._starts_with_step: Final = not is_wave and values[0] != neutral

    def value(self, since_ns: int) -> float:
        """Return what is added or multiplied, an instant after the beginning."""
        if not 0 <= since_ns < self.length_ns:
            return self._neutral
        if since_ns >= self._period_ns:
            since_ns %= self._period_ns
        right = bisect_right(self._times_ns, since_ns)
        before_ns, before = self._times_ns[right - 1], self._values[right - 1]
        share = (since_ns - before_ns) / (self._times_ns[right] - before_ns)
        return before + (self._values[right] - before) * share

    def corners_ns(self, from_ns: int, to_ns: int) -> list[int]:
        """Return all corners after `from_ns` and up to `to_ns` since the beginning, in order."""
        found: list[int] = []
        if self._starts_with_step and from_ns < -GRAIN_NS <= to_ns:
            found.append(-GRAIN_NS)
        last_ns = min(to_ns, self.length_ns)
        period_ns, times_ns = self._period_ns, self._times_ns
        base_ns = max(from_ns, 0) // period_ns * period_ns
        while base_ns <= last_ns:
            for index in range(bisect_right(times_ns, from_ns - base_ns), len(times_ns) - 1):
                corner_ns = base_ns + times_ns[index]
                if corner_ns > last_ns:
                    break
                found.append(corner_ns)
            base_ns += period_ns
        if self.length_ns < ENDLESS_NS:
            ends_ns = (self.length_ns - GRAIN_NS, self.length_ns) if self._is_cut else (self.length_ns,)
            found += [end_ns for end_ns in ends_ns if from_ns < end_ns <= to_ns and end_ns not in found]
            found.sort()
        return found

    def most_corners(self, span_ns: int) -> int:
        """Return the largest number of corners within any span of this length."""
        period_ns, periods = self._period_ns, 0
        if self.length_ns >= 2 * period_ns + span_ns:  # whole periods have the same number wherever they begin
            periods = span_ns // period_ns
            span_ns -= periods * period_ns
        until_ns = min(self.length_ns, 2 * period_ns + span_ns)
        corners_ns = self.corners_ns(-2 * GRAIN_NS, until_ns)
        most = first = 0
        for index in range(len(corners_ns)):
            while corners_ns[index] - corners_ns[first] >= span_ns and first < index:
                first += 1
            most = max(most, index - first + (span_ns > 0))
        return most + periods * (len(self._times_ns) - 1)

    def largest(self) -> float:
        """Return the largest magnitude that is added or multiplied."""
        return max([abs(value) for value in self._values])


def _polyline(form: Form) -> tuple[list[int], list[float]]:
    """Return the corners of one period, or of the whole form: instants that rise by a grain or more from 0, values."""
    if isinstance(form, Modulation):
        return _wave(form)
    if isinstance(form, Pulse):
        rise_s = form.ramp_s
        fall_s = form.length_s - rise_s
        points = [(0.0, 0.0), (rise_s, form.height_um), (fall_s, form.height_um), (form.length_s, 0.0)]
    else:
        points = list(form.points)
    times_ns: list[int] = []
    for t_s, _ in points:
        times_ns.append(max(_on_grid(t_s), times_ns[-1] + GRAIN_NS) if times_ns else 0)
    return times_ns, [value for _, value in points]


def _wave(form: Modulation) -> tuple[list[int], list[float]]:
    period_ns = _on_grid(1.0 / form.frequency_hz)
    high, low, half = 1.0, 1.0 - form.depth, 0.5 * form.depth
    if form.shape == "square":
        turn_ns = period_ns // (2 * GRAIN_NS) * GRAIN_NS
        return [0, turn_ns, turn_ns + GRAIN_NS, period_ns - GRAIN_NS, period_ns], [high, high, low, low, high]
    times_ns, values = [], []
    for corner in range(SINE_CORNERS + 1):
        t_ns = period_ns * corner // (SINE_CORNERS * GRAIN_NS) * GRAIN_NS
        value = 1.0 - half + half * _OUTSET * math.cos(2.0 * math.pi * t_ns / period_ns)
        times_ns.append(t_ns)
        values.append(value if value > 0.0 else 0.0)
    return times_ns, values


def _close(times_ns: list[int], values: list[float], after: float) -> None:
    """Let a form end with the value that follows it: at once, if its own last is another."""
    if values[-1] != after:
        times_ns.append(times_ns[-1] + GRAIN_NS)
        values.append(after)


def _on_grid(t_s: float) -> int:
    return round(t_s * 1e9 / GRAIN_NS) * GRAIN_NS
