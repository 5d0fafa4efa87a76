"""AHAP files (Apple Haptic and Audio Pattern): transient and continuous events, and curves of their parameters.

Sharpness 0 .. 1 makes transients shorter and steeper, and is 80 .. 230 Hz of the modulation of a continuous event.
"""

from __future__ import annotations

import os
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

from ..errors import RefusedError
from .document import Document
from .dropped import drop
from .track import Point, Tone, Track, within

BLUNT_HZ, SHARP_HZ = 80.0, 230.0
LONGEST_S = 30.0  # of an event, as in Core Haptics
MAX_ENTRIES = 10_000  # of a pattern
EVENT_PARAMETERS = ("HapticIntensity", "HapticSharpness")
INTENSITY, SHARPNESS = "HapticIntensityControl", "HapticSharpnessControl"


def track_of(path: str | os.PathLike[str]) -> Track:
    """Return the track of a file. Raises RefusedError."""
    pattern = Document.read(path).objects("Pattern", MAX_ENTRIES)
    curves: dict[str, list[Sequence[Point]]] = {INTENSITY: [], SHARPNESS: []}
    for one in pattern:
        if "ParameterCurve" in one:
            _add_curve(one.object("ParameterCurve"), curves)
        elif "Parameter" in one:
            _add_parameter(one.object("Parameter"), curves)
    track, controls = Track(), {name: _Control(found) for name, found in curves.items()}
    for one in pattern:
        if "Event" in one:
            _add_event(one.object("Event"), track, controls)
    return track


def _add_curve(curve: Document, curves: dict[str, list[Sequence[Point]]]) -> None:
    name, begin_s = curve.text("ParameterID"), _time_s(curve)
    points = [
        (begin_s + _time_s(point), point.number("ParameterValue"))
        for point in curve.objects("ParameterCurveControlPoints")
    ]
    if name not in curves:
        drop(f"parameter curves of {name}")
    elif points:
        curves[name].append(sorted(points, key=lambda point: point[0]))


def _add_parameter(parameter: Document, curves: dict[str, list[Sequence[Point]]]) -> None:
    name = parameter.text("ParameterID")
    if name in curves:
        curves[name].append([(_time_s(parameter), parameter.number("ParameterValue"))])
    else:
        drop(f"dynamic parameters {name}")


def _add_event(event: Document, track: Track, controls: dict[str, _Control]) -> None:
    kind, begin_s = event.text("EventType"), _time_s(event)
    if kind not in ("HapticTransient", "HapticContinuous"):
        drop(f"events {kind}")
        return
    given = {one.text("ParameterID"): one.number("ParameterValue") for one in event.objects("EventParameters")}
    for name in given.keys() - set(EVENT_PARAMETERS):
        drop(f"event parameters {name}")
    intensity = within(given.get("HapticIntensity", 1.0))
    intensities, sharpnesses = controls[INTENSITY], controls[SHARPNESS]
    sharpness = within(given.get("HapticSharpness", 0.5) + sharpnesses.value(begin_s, 0.0))
    if kind == "HapticTransient":
        track.pulse(begin_s, intensity * within(intensities.value(begin_s, 1.0)), sharpness)
        return
    end_s = begin_s + within(event.number("EventDuration", 0.0), LONGEST_S)
    if end_s <= begin_s:
        return
    if sharpnesses.times_s(begin_s, end_s):
        drop(f"{SHARPNESS} during an event: its value at the event's begin is played")
    times_s = [begin_s, *intensities.times_s(begin_s, end_s), end_s]
    track.count(len(times_s), event.where)
    track.lines.append([(t_s, intensity * within(intensities.value(t_s, 1.0))) for t_s in times_s])
    track.tone(Tone(begin_s, end_s, BLUNT_HZ + (SHARP_HZ - BLUNT_HZ) * sharpness))


def _time_s(document: Document) -> float:
    time_s = document.number("Time", 0.0)
    if time_s < 0.0:
        raise RefusedError(f"{document.where}.Time: must be 0 or more.")
    return time_s


class _Control:
    """All curves of one parameter, each of sorted points."""

    def __init__(self, curves: Sequence[Sequence[Point]]) -> None:
        self._curves = {curve[0][0]: curve for curve in reversed(curves)}  # of those that begin together, the first
        self._begins_s = sorted(self._curves)
        self._times_s = sorted({t_s for curve in curves for t_s, _ in curve})

    def times_s(self, begin_s: float, end_s: float) -> list[float]:
        """Return the times of all points between two instants."""
        return self._times_s[bisect_right(self._times_s, begin_s) : bisect_left(self._times_s, end_s)]

    def value(self, t_s: float, default: float) -> float:
        """Return the value of the curve that began last: linear between its points, beyond the last one that one's."""
        begun = bisect_right(self._begins_s, t_s)
        if begun == 0:
            return default
        curve = self._curves[self._begins_s[begun - 1]]
        after = bisect_right(curve, t_s, key=lambda point: point[0])
        from_s, value = curve[after - 1]
        if after == len(curve):
            return value
        to_s, next_value = curve[after]
        return value + (next_value - value) * (t_s - from_s) / (to_s - from_s)
