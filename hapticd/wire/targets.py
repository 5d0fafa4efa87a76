"""Decoder of one client's targets, field by field from a received map. The contract is clients/PROTOCOL.md.

It checks types and bounds; amplitude limits and finger ownership are checked in `core.targets`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ..errors import RequestError
from ..values import AmplitudeTarget, ClientTargets, FrictionTarget, GratingTarget, MapTarget, Target, VirtualPath
from .fields import Fields, bounded, items, label, whole

MAX_TARGETS = 16
MAX_VIRTUALS = 16
MAX_AMPLITUDE_UM = 1000.0
MIN_TTL_S, DEFAULT_TTL_S, MAX_TTL_S = 0.02, 0.5, 5.0
MAX_PATH_POINTS = 64
MAX_POSITION_MM = 1000.0
MAX_SPEED_MM_S, DEFAULT_SPEED_MM_S = 2000.0, 50.0
MIN_PERIOD_MM, MAX_PERIOD_MM = 0.1, 1000.0
MAX_ANGLE_RAD = 2 * math.pi
MAX_MAP_SIDE = 128
MAX_FINGER_ID = 2**32 - 1
MAX_STAMP = 2**63 - 1


def read_targets(fields: Fields) -> ClientTargets:
    """Read all fields of a `targets` message except its version. Raises RequestError."""
    client = fields.label("client")
    stamp = read_stamp(fields)
    ttl_s = fields.number("ttl_s", MIN_TTL_S, MAX_TTL_S, DEFAULT_TTL_S)
    virtuals: dict[str, VirtualPath] = {}
    for index, item in enumerate(fields.sequence("virtuals", MAX_VIRTUALS)):
        where = fields.place(f"virtuals[{index}]")
        name, path = _virtual(Fields(item, where))
        if name in virtuals:
            raise RequestError(f"{where}.name: {name!r} is listed twice.")
        virtuals[name] = path
    targets: dict[int | str, Target] = {}
    for index, item in enumerate(fields.sequence("targets", MAX_TARGETS)):
        where = fields.place(f"targets[{index}]")
        key, target = _finger_target(Fields(item, where))
        if key in targets:
            raise RequestError(f"{where}.finger: {key!r} is listed twice.")
        if isinstance(key, str) and key not in virtuals:
            raise RequestError(f"{where}.finger: this message defines no virtual finger {key!r}.")
        targets[key] = target
    fields.end()
    return ClientTargets(client, round(ttl_s * 1e9), targets, virtuals, stamp)


def _finger_target(fields: Fields) -> tuple[int | str, Target]:
    key = read_finger_key(fields)
    kinds = [name for name in _TARGET_READERS if name in fields]
    if len(kinds) != 1:
        raise RequestError(f"{fields.where}: needs exactly one of {', '.join(_TARGET_READERS)}.")
    target = _TARGET_READERS[kinds[0]](fields)
    fields.end()
    return key, target


def read_finger_key(fields: Fields) -> int | str:
    """Read the field `finger`: the id of a finger on the plate, or the name of a virtual one. Raises RequestError."""
    value, where = fields.take("finger"), fields.place("finger")
    return label(value, where) if isinstance(value, str) else whole(value, 1, MAX_FINGER_ID, where)


def read_stamp(fields: Fields) -> int | None:
    """Read the optional field `stamp`. Raises RequestError."""
    return fields.whole("stamp", 0, MAX_STAMP) if "stamp" in fields else None


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


_TARGET_READERS: dict[str, Callable[[Fields], Target]] = {
    "amplitude_um": _amplitude,
    "friction": _friction,
    "grating": _grating,
    "map": _map,
}


def _virtual(fields: Fields) -> tuple[str, VirtualPath]:
    name = fields.label("name")
    where = fields.place("path_mm")
    points = items(fields.take("path_mm"), MAX_PATH_POINTS, where)
    if not points:
        raise RequestError(f"{where}: needs at least one point.")
    path = VirtualPath(
        points_mm=tuple(_point(point, f"{where}[{index}]") for index, point in enumerate(points)),
        speed_mm_s=fields.number("speed_mm_s", 0.0, MAX_SPEED_MM_S, DEFAULT_SPEED_MM_S),
        loop=fields.boolean("loop", default=True),
    )
    fields.end()
    return name, path


def _point(value: object, where: str) -> tuple[float, float]:
    pair = items(value, 2, where)
    if len(pair) != 2:
        raise RequestError(f"{where}: a point has two numbers, x and y.")
    x_mm, y_mm = (bounded(number, -MAX_POSITION_MM, MAX_POSITION_MM, where) for number in pair)
    return x_mm, y_mm
