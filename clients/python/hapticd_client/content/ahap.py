"""AHAP files (Apple Haptic and Audio Pattern): transient and continuous events, and curves of their parameters.

Sharpness 0 .. 1 makes transients shorter and steeper, and is 80 .. 230 Hz of the modulation of a continuous event.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise

from .document import Document
from .dropped import drop
from .track import Point, Tone, Track

BLUNT_HZ, SHARP_HZ = 80.0, 230.0
LONGEST_S = 30.0  # of an event, as in Core Haptics
EVENT_PARAMETERS = ("HapticIntensity", "HapticSharpness")
INTENSITY, SHARPNESS = "HapticIntensityControl", "HapticSharpnessControl"


def track_of(path: str | os.PathLike[str]) -> Track:
    """Return the track of a file. Raises RefusedError."""
    pattern = Document.read(path).objects("Pattern")
    curves: dict[str, list[Sequence[Point]]] = {INTENSITY: [], SHARPNESS: []}
    for one in pattern:
        if "ParameterCurve" in one:
            _add_curve(one.object("ParameterCurve"), curves)
        elif "Parameter" in one:
            _add_parameter(one.object("Parameter"), curves)
    track = Track()
    for one in pattern:
        if "Event" in one:
            _add_event(one.object("Event"), track, curves)
    return track


def _add_curve(curve: Document, curves: dict[str, list[Sequence[Point]]]) -> None:
    name, begin_s = curve.text("ParameterID"), curve.number("Time", 0.0)
    points = [
        (begin_s + point.number("Time", 0.0), point.number("ParameterValue"))
        for point in curve.objects("ParameterCurveControlPoints")
    ]
    if name not in curves:
        drop(f"parameter curves of {name}")
    elif points:
        curves[name].append(sorted(points, key=lambda point: point[0]))


def _add_parameter(parameter: Document, curves: dict[str, list[Sequence[Point]]]) -> None:
    name = parameter.text("ParameterID")
    if name in curves:
        curves[name].append([(parameter.number("Time", 0.0), parameter.number("ParameterValue"))])
    else:
        drop(f"dynamic parameters {name}")


def _add_event(event: Document, track: Track, curves: dict[str, list[Sequence[Point]]]) -> None:
    kind, begin_s = event.text("EventType"), event.number("Time", 0.0)
    if kind not in ("HapticTransient", "HapticContinuous"):
        drop(f"events {kind}")
        return
    given = {one.text("ParameterID"): one.number("ParameterValue") for one in event.objects("EventParameters")}
    for name in given.keys() - set(EVENT_PARAMETERS):
        drop(f"event parameters {name}")
    intensity = _within(given.get("HapticIntensity", 1.0), 0.0, 1.0)
    sharpness = given.get("HapticSharpness", 0.5)
    intensities, sharpnesses = _inforce(curves[INTENSITY], begin_s), _inforce(curves[SHARPNESS], begin_s)
    sharpness = _within(sharpness + _value(sharpnesses, begin_s, 0.0), 0.0, 1.0)
    if kind == "HapticTransient":
        track.pulse(begin_s, intensity * _within(_value(intensities, begin_s, 1.0), 0.0, 1.0), sharpness)
        return
    end_s = begin_s + _within(event.number("EventDuration", 0.0), 0.0, LONGEST_S)
    if end_s <= begin_s:
        return
    if any(begin_s < t_s < end_s for t_s, _ in sharpnesses):
        drop(f"{SHARPNESS} during an event: its value at the event's begin is played")
    times_s = sorted({begin_s, end_s, *[t_s for t_s, _ in _points(curves[INTENSITY]) if begin_s < t_s < end_s]})
    line = [(t_s, intensity * _within(_value(_inforce(curves[INTENSITY], t_s), t_s, 1.0), 0.0, 1.0)) for t_s in times_s]
    track.lines.append(line)
    track.tone(Tone(begin_s, end_s, BLUNT_HZ + (SHARP_HZ - BLUNT_HZ) * sharpness))


def _points(curves: Sequence[Sequence[Point]]) -> list[Point]:
    return [point for curve in curves for point in curve]


def _inforce(curves: Sequence[Sequence[Point]], t_s: float) -> Sequence[Point]:
    """Return the curve that began last before an instant."""
    begun = [curve for curve in curves if curve[0][0] <= t_s]
    return max(begun, key=lambda curve: curve[0][0], default=())


def _value(curve: Sequence[Point], t_s: float, default: float) -> float:
    """Return a curve's value, linear between its points; beyond the last one that one's."""
    for (from_s, value), (to_s, next_value) in pairwise(curve):
        if from_s <= t_s < to_s:
            return value + (next_value - value) * (t_s - from_s) / (to_s - from_s)
    return curve[-1][1] if curve else default


def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
