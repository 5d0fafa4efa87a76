"""Decoder of one client's targets, field by field from a received map. The contract is clients/PROTOCOL.md.

It checks types and bounds; amplitude limits and finger ownership are checked in `core.targets`.
"""

from __future__ import annotations

from collections.abc import Container
from functools import partial

from ..content_values import ClientTargets, Target
from ..errors import RequestError
from .contents import read_content
from .effects import MAX_FINGER_ID, read_effects
from .fields import Fields, label, whole
from .paths import read_path
from .surfaces import MAX_SURFACES, read_surface

MAX_TARGETS = 16
MAX_VIRTUALS = 16
MIN_TTL_S, DEFAULT_TTL_S, MAX_TTL_S = 0.02, 0.5, 5.0
MAX_PRIORITY = 3
MAX_STAMP = 2**63 - 1


def read_targets(fields: Fields) -> ClientTargets:
    """Read all fields of a `targets` message except its version. Raises RequestError."""
    client = fields.label("client")
    stamp = read_stamp(fields)
    ttl_s = fields.number("ttl_s", MIN_TTL_S, MAX_TTL_S, DEFAULT_TTL_S)
    virtuals = fields.table("virtuals", MAX_VIRTUALS, lambda one: (one.label("name"), read_path(one)))
    requested = fields.table("targets", MAX_TARGETS, partial(_finger_target, virtuals), "finger")
    targets = {key: target for key, (target, _) in requested.items()}
    priorities = {key: priority for key, (_, priority) in requested.items() if priority > 0}
    surfaces = fields.table("surfaces", MAX_SURFACES, read_surface)
    effects = read_effects(fields, surfaces)
    fields.end()
    return ClientTargets(client, round(ttl_s * 1e9), targets, virtuals, stamp, surfaces, effects, priorities)


def _finger_target(virtuals: Container[str], fields: Fields) -> tuple[int | str, tuple[Target, int]]:
    key = read_finger_key(fields)
    target = read_content(fields)
    priority = fields.whole("priority", 0, MAX_PRIORITY) if "priority" in fields else 0
    fields.end()
    if isinstance(key, str) and key not in virtuals:
        raise RequestError(f"{fields.place('finger')}: this message defines no virtual finger {key!r}.")
    return key, (target, priority)


def read_finger_key(fields: Fields) -> int | str:
    """Read the field `finger`: the id of a finger on the plate, or the name of a virtual one. Raises RequestError."""
    value, where = fields.take("finger"), fields.place("finger")
    return label(value, where) if isinstance(value, str) else whole(value, 1, MAX_FINGER_ID, where)


def read_stamp(fields: Fields) -> int | None:
    """Read the optional field `stamp`. Raises RequestError."""
    return fields.whole("stamp", 0, MAX_STAMP) if "stamp" in fields else None
