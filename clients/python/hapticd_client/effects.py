"""Forms of effects in time, and what starts them, validated like in the daemon."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import SupportsIndex

from .errors import RefusedError
from .messages import FingerState
from .targets import MAX_AMPLITUDE_UM, Fields, label, number

MAX_ENVELOPE_POINTS = 256
MIN_LENGTH_S, MAX_LENGTH_S = 0.001, 60.0
MAX_FACTOR = 10.0
SHAPES = ("sine", "square")
MAX_INSTANT_NS = 2**63 - 1


# --- forms --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Pulse:
    """`height_um` added for `length_s`, with a linear rise and fall of `rise_s` each; a negative height is a dip.

    `rise_s` is by default 2 ms, or half of the length if that is less.
    """

    height_um: float
    length_s: float
    rise_s: float | None = None

    def fields(self) -> Fields:
        """Return the field of the message. Raises RefusedError."""
        length_s = number("length_s", self.length_s, MIN_LENGTH_S, MAX_LENGTH_S)
        rise = {} if self.rise_s is None else {"rise_s": number("rise_s", self.rise_s, 0.0, 0.5 * length_s)}
        height_um = number("height_um", self.height_um, -MAX_AMPLITUDE_UM, MAX_AMPLITUDE_UM)
        return {"pulse": {"height_um": height_um, "length_s": length_s, **rise}}


@dataclass(frozen=True, slots=True)
class Envelope:
    """2 .. 256 points (t_s, value) from 0 s on, linear in between; two at one instant are a step.

    Values are um that are added, or with `is_factor` factors 0 .. 10 of what the finger feels.
    """

    points: Iterable[Sequence[float]]
    is_factor: bool = False

    def fields(self) -> Fields:
        """Return the field of the message. Raises RefusedError."""
        low, high = (0.0, MAX_FACTOR) if self.is_factor else (-MAX_AMPLITUDE_UM, MAX_AMPLITUDE_UM)
        try:
            points = [_point(one, low, high) for one in self.points]
        except TypeError:
            raise RefusedError("points: must be a list of points, each with its time in s and its value.") from None
        if not 2 <= len(points) <= MAX_ENVELOPE_POINTS:
            raise RefusedError(f"points: has {len(points)} points, it must have 2 .. {MAX_ENVELOPE_POINTS}.")
        if points[0][0] != 0.0 or points[-1][0] < MIN_LENGTH_S:
            raise RefusedError(f"points: must begin at 0 s and last {MIN_LENGTH_S:g} s or more.")
        if any(after[0] < before[0] for before, after in pairwise(points)):
            raise RefusedError("points: a point must not be earlier than the one before it.")
        return {"envelope": {"points": points, "is_factor": bool(self.is_factor)}}


@dataclass(frozen=True, slots=True)
class Modulation:
    """What the finger feels, times 1 - depth/2 + depth/2 * wave, which begins at 1.

    `shape` is "sine" or "square". Without `length_s` it plays until it is stopped.
    """

    frequency_hz: float
    depth: float = 1.0
    shape: str = "sine"
    length_s: float | None = None

    def fields(self) -> Fields:
        """Return the field of the message. Raises RefusedError."""
        if self.shape not in SHAPES:
            raise RefusedError(f"shape: must be one of {', '.join(SHAPES)}.")
        length = {} if self.length_s is None else {"length_s": number("length_s", self.length_s, 0.001, MAX_LENGTH_S)}
        return {
            "modulation": {
                "frequency_hz": number("frequency_hz", self.frequency_hz, 1.0, 300.0),
                "depth": number("depth", self.depth, 0.0, 1.0),
                "shape": self.shape,
                **length,
            }
        }


Form = Pulse | Envelope | Modulation


# --- starts -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Now:
    """When the message arrives; each call starts it once more."""

    def fields(self) -> Fields:
        """Return the fields of the message."""
        return {"cause": "now", "id": time.monotonic_ns()}


@dataclass(frozen=True, slots=True)
class At:
    """At an instant of the daemon's monotonic clock (ns); a late message plays what is left."""

    t_ns: int

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        if not isinstance(self.t_ns, SupportsIndex) or not 0 <= self.t_ns.__index__() <= MAX_INSTANT_NS:
            raise RefusedError(f"t_ns: must be a whole number, 0 .. {MAX_INSTANT_NS}.")
        return {"cause": "at", "t_ns": self.t_ns.__index__()}


@dataclass(frozen=True, slots=True)
class OnLanding:
    """Each time a finger lands; that finger feels it."""

    def fields(self) -> Fields:
        """Return the fields of the message."""
        return {"cause": "landing"}


@dataclass(frozen=True, slots=True)
class OnLifting:
    """Each time a finger lifts; the others feel it."""

    def fields(self) -> Fields:
        """Return the fields of the message."""
        return {"cause": "lifting"}


@dataclass(frozen=True, slots=True)
class OnEntering:
    """Each time a finger is predicted to enter one of this client's surfaces; that finger feels it."""

    surface: str

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        return {"cause": "entering", "surface": label("surface", self.surface)}


@dataclass(frozen=True, slots=True)
class OnLeaving:
    """Each time a finger is predicted to leave one of this client's surfaces; that finger feels it."""

    surface: str

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        return {"cause": "leaving", "surface": label("surface", self.surface)}


@dataclass(frozen=True, slots=True)
class OnCrossing:
    """Each time a finger is predicted to cross the edge of one of this client's surfaces; that finger feels it."""

    surface: str

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        return {"cause": "crossing", "surface": label("surface", self.surface)}


@dataclass(frozen=True, slots=True)
class OnPressure:
    """Each time a finger's pressure (0 .. 1) reaches `threshold`, after it was `release` or less; that finger feels it.

    `release` is by default three quarters of the threshold.
    """

    threshold: float
    release: float | None = None

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        threshold = number("threshold", self.threshold, 0.01, 1.0)
        release = 0.75 * threshold if self.release is None else number("release", self.release, 0.0, 1.0)
        if release >= threshold:
            raise RefusedError("release: must be below the threshold.")
        return {"cause": "pressure", "threshold": threshold, "release": release}


Start = Now | At | OnLanding | OnLifting | OnEntering | OnLeaving | OnCrossing | OnPressure


def effect_fields(form: Form, on: FingerState | int | str | None, start: Start, loops: bool) -> Fields:
    """Return the fields of an effect apart from its name. Raises RefusedError."""
    if not isinstance(form, Form):
        raise RefusedError(f"form: must be a Pulse, an Envelope or a Modulation, not {repr(form)[:40]}.")
    if not isinstance(start, Start):
        raise RefusedError(f"start: must be one of Now, At, OnLanding and the other causes, not {repr(start)[:40]}.")
    is_endless = bool(loops) or (isinstance(form, Modulation) and form.length_s is None)
    if is_endless and isinstance(start, OnLifting | OnCrossing):
        raise RefusedError("effect: what starts by lifting or crossing would never end: give it a length.")
    return {**form.fields(), **_scope(on), "start": start.fields(), "loops": bool(loops)}


def _scope(on: FingerState | int | str | None) -> Fields:
    if on is None:
        return {}
    if isinstance(on, str):
        return {"surface": label("on", on)}
    finger = on.id if isinstance(on, FingerState) else on
    if isinstance(finger, bool | str) or not isinstance(finger, SupportsIndex):
        raise RefusedError(f"on: must be a finger on the plate, the name of a surface or None, not {repr(on)[:40]}.")
    return {"finger": int(number("on", finger.__index__(), 1, 2**32 - 1))}


def _point(point: Sequence[float], low: float, high: float) -> list[float]:
    numbers = list(point)
    if len(numbers) != 2:
        raise RefusedError("points: a point has two numbers, its time in s and its value.")
    return [number("points", numbers[0], 0.0, MAX_LENGTH_S), number("points", numbers[1], low, high)]
