"""Bodies of replies on the `control` socket. That of `status`, the daemon's health, is maps of counters."""

from __future__ import annotations

from typing import Any

from msgspec import Struct

from .base import MAX_MESSAGE_BYTES, MAX_PART_BYTES, PROTOCOL_VERSION
from .contents import CONTENTS, MAX_ASSET_SIDE, MAX_MAP_SIDE
from .effects import FORMS, MAX_ENVELOPE_POINTS
from .requests import MAX_ASSET_BYTES, MAX_MARKER_CHARACTERS, OPS
from .surfaces import MAX_PATH_POINTS, MAX_POLYGON_POINTS
from .targets import (
    MAX_EFFECTS,
    MAX_POINTS,
    MAX_PRIORITY,
    MAX_SURFACES,
    MAX_TARGETS,
    MAX_TTL_S,
    MAX_VIRTUALS,
    MIN_TTL_S,
)

OPTIONAL = (
    *("stamp", "surfaces", "surface_path", "friction_map", "assets", "effects", "priority", "marker_fields"),
    "person",
)


class Capabilities(Struct, frozen=True):
    """Everything a client may set, and its bounds."""

    protocol: int = PROTOCOL_VERSION
    ops: tuple[str, ...] = OPS
    optional: tuple[str, ...] = OPTIONAL
    """fields added within this version: a client sends only those listed here"""
    targets: tuple[str, ...] = CONTENTS
    max_targets: int = MAX_TARGETS
    max_virtuals: int = MAX_VIRTUALS
    max_priority: int = MAX_PRIORITY
    max_path_points: int = MAX_PATH_POINTS
    max_surfaces: int = MAX_SURFACES
    max_polygon_points: int = MAX_POLYGON_POINTS
    max_map_side: int = MAX_MAP_SIDE
    max_asset_side: int = MAX_ASSET_SIDE
    max_asset_bytes: int = MAX_ASSET_BYTES
    max_part_bytes: int = MAX_PART_BYTES
    effects: tuple[str, ...] = FORMS
    max_effects: int = MAX_EFFECTS
    max_envelope_points: int = MAX_ENVELOPE_POINTS
    max_points: int = MAX_POINTS
    """of all envelopes"""
    max_marker_characters: int = MAX_MARKER_CHARACTERS
    max_message_bytes: int = MAX_MESSAGE_BYTES
    ttl_s: tuple[float, float] = (MIN_TTL_S, MAX_TTL_S)


class Hello(Capabilities, frozen=True, kw_only=True):
    """The reply to `hello`."""

    version: str
    """of the daemon"""
    instance: int
    """changes when the daemon restarts"""


class Released(Struct, frozen=True):
    """The reply to `release`."""

    released: bool
    """false if the client did not own the finger"""


class Have(Struct, frozen=True):
    """The reply to `asset`."""

    have: int
    """the number of bytes that are here"""


class Marked(Struct, frozen=True):
    """The reply to `marker`."""

    t_ns: int
    """its arrival"""


class Reach(Struct, frozen=True):
    """The reply to `reach`."""

    friction: tuple[float, float] | None
    """the lowest and the highest friction that this finger, or one that touched there, could feel now, within a just
    noticeable difference, while the other fingers with their targets feel what they ask for, within one, or as well as
    without it; nil if there is none. Where it is not one interval, the longest"""


class Surfaces(Struct, frozen=True):
    """The reply to `surfaces`."""

    version: int
    """as `surfaces_version` in telemetry"""
    surfaces: tuple[dict[str, Any], ...]
    """all in force, topmost first: each with its `client` and the fields of a surface, its pose at its `t_pose_ns`, a
    rectangle as `polygon_mm`, and of a map 32 pixels per side at most"""


class Plate(Struct, frozen=True):
    """The reply to `plate`: what a picture of the plate needs."""

    size_mm: tuple[float, ...]
    w_limit_um: tuple[float, ...]
    """the largest amplitude of each mode"""
    reference_limit_um: tuple[float, ...]
    """the largest reference of each mode"""
    contact_radius_mm: float
    """of contacts, where the pad's ellipses are not used; 0: points"""
    friction_curve: tuple[tuple[float, float], ...]
    """pairs of an amplitude in um and its friction relative to bare glass; its logarithm is linear in between"""
    friction_speed_mm_s: float | None
    """the sliding speed at which a friction needs twice the amplitude; nil: speed changes nothing"""
    drive_hz: float | None
    """nil until the board answered"""
    x_mm: tuple[float, ...]
    """the grid of `shapes`"""
    y_mm: tuple[float, ...]
    modes: int
    shapes: bytes
    """the mode map on that grid: float32, little-endian, by mode, then by rows along y"""
    simulated: str | None
    """the simulated rig's directory"""
