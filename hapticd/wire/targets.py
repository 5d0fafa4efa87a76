"""Decoder of one client's targets, field by field from a received map. The contract is clients/PROTOCOL.md.

It checks types and bounds; amplitude limits and finger ownership are checked in `core.targets`.
"""

from __future__ import annotations

from ..content_values import ClientTargets, Surface, Target, VirtualPath
from ..errors import RequestError
from .contents import read_content
from .effects import MAX_FINGER_ID, read_effects
from .fields import Fields, label, whole
from .paths import read_path
from .surfaces import MAX_SURFACES, read_surface

MAX_TARGETS = 16
MAX_VIRTUALS = 16
MIN_TTL_S, DEFAULT_TTL_S, MAX_TTL_S = 0.02, 0.5, 5.0
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
    surfaces: dict[str, Surface] = {}
    for index, item in enumerate(fields.sequence("surfaces", MAX_SURFACES)):
        where = fields.place(f"surfaces[{index}]")
        name, surface = read_surface(Fields(item, where))
        if name in surfaces:
            raise RequestError(f"{where}.name: {name!r} is listed twice.")
        surfaces[name] = surface
    effects = read_effects(fields, surfaces)
    fields.end()
    return ClientTargets(client, round(ttl_s * 1e9), targets, virtuals, stamp, surfaces, effects)


def _finger_target(fields: Fields) -> tuple[int | str, Target]:
    key = read_finger_key(fields)
    target = read_content(fields)
    fields.end()
    return key, target


def read_finger_key(fields: Fields) -> int | str:
    """Read the field `finger`: the id of a finger on the plate, or the name of a virtual one. Raises RequestError."""
    value, where = fields.take("finger"), fields.place("finger")
    return label(value, where) if isinstance(value, str) else whole(value, 1, MAX_FINGER_ID, where)


def read_stamp(fields: Fields) -> int | None:
    """Read the optional field `stamp`. Raises RequestError."""
    return fields.whole("stamp", 0, MAX_STAMP) if "stamp" in fields else None


def _virtual(fields: Fields) -> tuple[str, VirtualPath]:
    name = fields.label("name")
    path = read_path(fields)
    fields.end()
    return name, path
