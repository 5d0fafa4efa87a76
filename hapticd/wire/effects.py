"""Decoder of one effect, field by field from a received map. The contract is clients/PROTOCOL.md.

It checks types and bounds; amplitude limits, what a frame can carry and the number of all effects are checked in
`core.targets`.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from functools import partial

from ..content_values import Cause, Effect, Envelope, Form, Modulation, Pulse, Start, Wave
from ..errors import RequestError
from .contents import MAX_AMPLITUDE_UM
from .fields import Fields, bounded, items
from .surfaces import MAX_INSTANT_NS

MAX_EFFECTS = 16
MAX_ENVELOPE_POINTS = 256
MAX_POINTS = 1024  # of all envelopes of a message
MIN_LENGTH_S, MAX_LENGTH_S = 0.001, 60.0
DEFAULT_RISE_S = 0.002
MAX_FACTOR = 10.0
MIN_FREQUENCY_HZ, MAX_FREQUENCY_HZ = 1.0, 300.0
MIN_PRESSURE_FRAC = 0.01
RELEASE_SHARE = 0.75  # of the threshold, where a client names no release
MAX_FINGER_ID = 2**32 - 1
BY_SURFACE = (Cause.ENTERING, Cause.LEAVING, Cause.CROSSING)
WITHOUT_END = (Cause.LIFTING, Cause.CROSSING)  # nothing undoes them, so nothing would end what they start


def read_effect(fields: Fields, surfaces: Container[str]) -> tuple[str, Effect]:
    """Read an effect and its name; it may name these surfaces. Raises RequestError."""
    name = fields.label("name")
    kind = fields.only(FORMS)
    effect = Effect(
        form=fields.inner(kind, _FORMS[kind]),
        on=_scope(fields, surfaces),
        start=fields.inner("start", partial(_start, surfaces)) if "start" in fields else Start(),
        loops=fields.boolean("loops", default=False),
    )
    fields.end()
    if effect.start.cause in WITHOUT_END and is_endless(effect):
        raise RequestError(
            f"{fields.where}: would never end: an effect that starts by {effect.start.cause.value} needs a length."
        )
    return name, effect


def read_effects(fields: Fields, surfaces: Container[str]) -> dict[str, Effect]:
    """Read the list `effects`. Raises RequestError."""
    points = 0

    def read(one: Fields) -> tuple[str, Effect]:
        nonlocal points
        name, effect = read_effect(one, surfaces)
        points += len(effect.form.points) if isinstance(effect.form, Envelope) else 0
        if points > MAX_POINTS:
            raise RequestError(f"{one.where}.envelope: more than {MAX_POINTS} points in one message.")
        return name, effect

    return fields.table("effects", MAX_EFFECTS, read)


def is_endless(effect: Effect) -> bool:
    """Return whether an effect plays until something ends it."""
    return effect.loops or (isinstance(effect.form, Modulation) and effect.form.length_s is None)


def _pulse(fields: Fields) -> Pulse:
    length_s = fields.number("length_s", MIN_LENGTH_S, MAX_LENGTH_S)
    return Pulse(
        height_um=fields.number("height_um", -MAX_AMPLITUDE_UM, MAX_AMPLITUDE_UM),
        length_s=length_s,
        rise_s=fields.number("rise_s", 0.0, 0.5 * length_s, min(DEFAULT_RISE_S, 0.5 * length_s)),
    )


def _envelope(fields: Fields) -> Envelope:
    is_factor = fields.boolean("is_factor", default=False)
    low, high = (0.0, MAX_FACTOR) if is_factor else (-MAX_AMPLITUDE_UM, MAX_AMPLITUDE_UM)
    where = fields.place("points")
    points: list[tuple[float, float]] = []
    before_s = 0.0
    for index, item in enumerate(items(fields.take("points"), MAX_ENVELOPE_POINTS, where)):
        t_s, value = _point(item, before_s, low, high, where, index)
        points.append((t_s, value))
        before_s = t_s
    if len(points) < 2 or points[0][0] != 0.0 or before_s < MIN_LENGTH_S:
        raise RequestError(f"{where}: must begin at 0 s and last {MIN_LENGTH_S:g} s or more.")
    return Envelope(tuple(points), is_factor)


def _point(item: object, before_s: float, low: float, high: float, where: str, index: int) -> tuple[float, float]:
    if type(item) is list and len(item) == 2:  # a sound point in a third of the time: a message may have a thousand
        t_s, value = item
        if type(t_s) is float and type(value) is float and before_s <= t_s <= MAX_LENGTH_S and low <= value <= high:
            return t_s, value
    place = f"{where}[{index}]"
    numbers = items(item, 2, place)
    if len(numbers) != 2:
        raise RequestError(f"{place}: a point has two numbers, its time in s and its value.")
    t_s = bounded(numbers[0], 0.0, MAX_LENGTH_S, place)
    if t_s < before_s:
        raise RequestError(f"{place}: is earlier than the point before it.")
    return t_s, bounded(numbers[1], low, high, place)


def _modulation(fields: Fields) -> Modulation:
    return Modulation(
        frequency_hz=fields.number("frequency_hz", MIN_FREQUENCY_HZ, MAX_FREQUENCY_HZ),
        depth_frac=fields.number("depth", 0.0, 1.0),
        wave=fields.choice("shape", Wave) if "shape" in fields else Wave.SINE,
        length_s=fields.number("length_s", MIN_LENGTH_S, MAX_LENGTH_S) if "length_s" in fields else None,
    )


_FORMS: dict[str, Callable[[Fields], Form]] = {"pulse": _pulse, "envelope": _envelope, "modulation": _modulation}
FORMS = tuple(_FORMS)


def _scope(fields: Fields, surfaces: Container[str]) -> int | str | None:
    if "finger" in fields and "surface" in fields:
        raise RequestError(f"{fields.where}: is on a finger or on a surface, not on both.")
    if "finger" in fields:
        return fields.whole("finger", 1, MAX_FINGER_ID)
    return _surface(fields, surfaces) if "surface" in fields else None


def _surface(fields: Fields, surfaces: Container[str]) -> str:
    name = fields.label("surface")
    if name not in surfaces:
        raise RequestError(f"{fields.place('surface')}: this message defines no surface {name!r}.")
    return name


def _start(surfaces: Container[str], fields: Fields) -> Start:
    cause = fields.choice("cause", Cause)
    if cause is Cause.NOW:
        return Start(cause, start_id=fields.whole("id", 0, MAX_INSTANT_NS) if "id" in fields else 0)
    if cause is Cause.AT:
        return Start(cause, t_ns=fields.whole("t_ns", 0, MAX_INSTANT_NS))
    if cause in BY_SURFACE:
        return Start(cause, surface=_surface(fields, surfaces))
    if cause is not Cause.PRESSURE:
        return Start(cause)
    threshold_frac = fields.number("threshold", MIN_PRESSURE_FRAC, 1.0)
    release_frac = fields.number("release", 0.0, 1.0, RELEASE_SHARE * threshold_frac)
    if release_frac >= threshold_frac:
        raise RequestError(f"{fields.place('release')}: must be below the threshold.")
    return Start(cause, threshold_frac=threshold_frac, release_frac=release_frac)
