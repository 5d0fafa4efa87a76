"""Decoder of content: what a finger is to feel, as a target of its own or on a surface."""

from __future__ import annotations

import math
from collections.abc import Callable

from ..errors import RequestError
from ..values import AmplitudeTarget, FrictionTarget, GratingTarget, MapTarget, Target
from .fields import Fields

MAX_AMPLITUDE_UM = 1000.0
MIN_PERIOD_MM, MAX_PERIOD_MM = 0.1, 1000.0
MAX_ANGLE_RAD = 2 * math.pi
MAX_MAP_SIDE = 128
MAX_POSITION_MM = 1000.0


def _amplitude(fields: Fields) -> AmplitudeTarget:
    return AmplitudeTarget(fields.number("amplitude_um", 0.0, MAX_AMPLITUDE_UM))


def _friction(fields: Fields) -> FrictionTarget:
    return FrictionTarget(fields.number("friction", 0.0, 1.0))


def _grating(fields: Fields) -> GratingTarget:
    grating = Fields(fields.take("grating"), fields.place("grating"))
    target = GratingTarget(
        period_mm=grating.number("period_mm", MIN_PERIOD_MM, MAX_PERIOD_MM),
        angle_rad=grating.number("angle_rad", -MAX_ANGLE_RAD, MAX_ANGLE_RAD, 0.0),
        low_um=grating.number("low_um", 0.0, MAX_AMPLITUDE_UM, 0.0),
        high_um=grating.number("high_um", 0.0, MAX_AMPLITUDE_UM),
        duty_frac=grating.number("duty_frac", 0.0, 1.0, 0.0),
    )
    grating.end()
    return target


def _map(fields: Fields) -> MapTarget:
    image = Fields(fields.take("map"), fields.place("map"))
    width = image.whole("width", 1, MAX_MAP_SIDE)
    height = image.whole("height", 1, MAX_MAP_SIDE)
    target = MapTarget(
        width=width,
        height=height,
        levels=image.binary("levels", width * height),
        low_um=image.number("low_um", 0.0, MAX_AMPLITUDE_UM, 0.0),
        high_um=image.number("high_um", 0.0, MAX_AMPLITUDE_UM),
    )
    image.end()
    return target


_READERS: dict[str, Callable[[Fields], Target]] = {
    "amplitude_um": _amplitude,
    "friction": _friction,
    "grating": _grating,
    "map": _map,
}


def read_content(fields: Fields) -> Target:
    """Read the one field of content. Raises RequestError."""
    kinds = [name for name in _READERS if name in fields]
    if len(kinds) != 1:
        raise RequestError(f"{fields.where}: needs exactly one of {', '.join(_READERS)}.")
    return _READERS[kinds[0]](fields)
