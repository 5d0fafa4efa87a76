"""Client messages, one MessagePack map each. The contract is clients/PROTOCOL.md.

    targets    client -> daemon   decode_targets    all targets of one client
    control    client -> daemon   decode_request    a request with an id; encode_reply or encode_error answers it
    telemetry  daemon -> clients  encode_state      the state of every finger

Decoders raise RequestError, with one sentence for the sender, and nothing else for any bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import msgpack

from ..content_values import ClientTargets
from ..errors import RequestError
from ..values import PlateEvent
from .assets import MAX_ASSET_BYTES, AssetPart, read_asset_part
from .contents import CONTENTS, MAX_ASSET_SIDE, MAX_MAP_SIDE
from .effects import FORMS, MAX_EFFECTS, MAX_ENVELOPE_POINTS, MAX_POINTS
from .fields import MAX_BINARY_BYTES, MAX_PAYLOAD_BYTES, Fields, peek_whole, unpack
from .paths import MAX_PATH_POINTS
from .surfaces import MAX_POLYGON_POINTS, MAX_SURFACES
from .targets import (
    MAX_PRIORITY,
    MAX_TARGETS,
    MAX_TTL_S,
    MAX_VIRTUALS,
    MIN_TTL_S,
    read_finger_key,
    read_stamp,
    read_targets,
)

PROTOCOL_VERSION = 1
OPS = (
    "hello",
    "capabilities",
    "set",
    "release",
    "status",
    "plate",
    "clear_fault",
    "marker",
    "asset",
    "surfaces",
    "reach",
)

MAX_REQUEST_ID = 2**32 - 1
MAX_MARKER_CHARACTERS = 100
MAX_PLACE_MM = 1000.0
UNREAD_REQUEST_ID = 0  # in the reply to a request whose own id could not be read

CAPABILITIES: Mapping[str, object] = {
    "protocol": PROTOCOL_VERSION,
    "ops": OPS,
    # Fields added within this version: a client sends only those listed here.
    "optional": ("stamp", "surfaces", "surface_path", "friction_map", "assets", "effects", "priority"),
    "targets": CONTENTS,
    "max_targets": MAX_TARGETS,
    "max_virtuals": MAX_VIRTUALS,
    "max_priority": MAX_PRIORITY,
    "max_path_points": MAX_PATH_POINTS,
    "max_surfaces": MAX_SURFACES,
    "max_polygon_points": MAX_POLYGON_POINTS,
    "max_map_side": MAX_MAP_SIDE,
    "max_asset_side": MAX_ASSET_SIDE,
    "max_asset_bytes": MAX_ASSET_BYTES,
    "max_part_bytes": MAX_BINARY_BYTES,
    "effects": FORMS,
    "max_effects": MAX_EFFECTS,
    "max_envelope_points": MAX_ENVELOPE_POINTS,
    "max_points": MAX_POINTS,
    "max_marker_characters": MAX_MARKER_CHARACTERS,
    "max_message_bytes": MAX_PAYLOAD_BYTES,
    "ttl_s": (MIN_TTL_S, MAX_TTL_S),
}


@dataclass(frozen=True, slots=True)
class Release:
    """Release one finger (its id, or a virtual finger's name), or with None all fingers of the client.

    `stamp` as in ClientTargets.
    """

    client: str
    finger: int | str | None
    stamp: int | None = None


@dataclass(frozen=True, slots=True)
class Marker:
    """A client's label for an instant of its experiment; `t_ns` is its arrival at the daemon, 0 before that.

    `has_pulse`: the board's sync output rises with the next reference that takes effect.
    """

    client: str
    text: str
    t_ns: int = 0
    has_pulse: bool = False


@dataclass(frozen=True, slots=True)
class ReachQuery:
    """Which friction a finger can feel now: its id, a virtual finger's name, or with None one that touched
    `place_mm`."""

    finger: int | str | None
    place_mm: tuple[float, float] = (0.0, 0.0)


Body = ReachQuery | ClientTargets | Release | Marker | AssetPart | None


@dataclass(frozen=True, slots=True)
class Request:
    """One control request. `body` is ClientTargets for "set", Release for "release", Marker for "marker", AssetPart for
    "asset", ReachQuery for "reach", else None."""

    op: str
    id: int
    body: Body


class FingerState(NamedTuple):
    """One finger in a telemetry message; None where nothing was computed, as for a finger without a target.

    `owner` is the client that owns it; the fields from `friction_change` on are those of `values.Perceived`.
    """

    id: int | str
    x_mm: float
    y_mm: float
    predicted_x_mm: float | None
    predicted_y_mm: float | None
    target_um: float | None
    achieved_um: float | None
    virtual: bool
    owner: str | None = None
    friction_change: float | None = None
    weber_frac: float | None = None
    contact_um: float | None = None
    felt_friction: float | None = None
    error_jnd: float | None = None


class PlateState(NamedTuple):
    """One telemetry message. `instance` changes with every start of the daemon; `seq` counts its messages.

    `age_ms` is the newest touch sample's age, `horizon_ms` how far ahead of it the plate is driven, `state` the
    supervisor's state.
    `modal_um` are the reference phasors, `measured_um` those last measured by the board; `markers` and `events` came
    since the previous message. `tick_late_ms` is the delay of the newest timer tick; `missed_ticks` and `pauses` (of
    Python's collector, above 1 ms) count since the start, as `surfaces_version` does changes of the surfaces in force.
    """

    instance: int
    seq: int
    t_ns: int
    state: str
    fingers: tuple[FingerState, ...]
    modal_um: tuple[complex, ...]
    limited: bool
    age_ms: float
    horizon_ms: float
    markers: tuple[Marker, ...] = ()
    measured_um: tuple[complex, ...] = ()
    tick_late_ms: float = 0.0
    missed_ticks: int = 0
    pauses: int = 0
    surfaces_version: int = 0
    events: tuple[PlateEvent, ...] = ()


# --- targets ----------------------------------------------------------------------------------------------------


def decode_targets(payload: bytes) -> ClientTargets:
    """Decode a message of the `targets` socket. Raises RequestError."""
    fields = Fields(unpack(payload))
    _check_version(fields)
    return read_targets(fields)


def _check_version(fields: Fields) -> None:
    version = fields.whole("v", 0, MAX_REQUEST_ID)
    if version != PROTOCOL_VERSION:
        older = "client" if version < PROTOCOL_VERSION else "daemon"
        raise RequestError(
            f"The message has protocol version {version}, the daemon has {PROTOCOL_VERSION}: update the {older}."
        )


# --- control ----------------------------------------------------------------------------------------------------


def decode_request(payload: bytes) -> Request:
    """Decode a message of the `control` socket. Raises RequestError."""
    fields = Fields(unpack(payload))
    return _request(fields, fields.whole("id", 1, MAX_REQUEST_ID))


def answer(payload: bytes, handle: Callable[[Request], Mapping[str, object]]) -> bytes:
    """Return the reply to a control message: the result of `handle`, or the sentence of a RequestError."""
    try:
        request = decode_request(payload)
        return encode_reply(request.id, handle(request))
    except RequestError as error:
        request_id = peek_whole(payload, "id") or UNREAD_REQUEST_ID
        return encode_error(request_id if 0 < request_id <= MAX_REQUEST_ID else UNREAD_REQUEST_ID, str(error))


def encode_reply(request_id: int, body: Mapping[str, object]) -> bytes:
    """Encode the reply to a successful request. `body` holds plain values, lists and maps."""
    return bytes(msgpack.packb({"v": PROTOCOL_VERSION, "id": request_id, "ok": True, "body": dict(body)}))


def encode_error(request_id: int, sentence: str) -> bytes:
    """Encode the reply to a refused request."""
    return bytes(msgpack.packb({"v": PROTOCOL_VERSION, "id": request_id, "ok": False, "error": sentence}))


REFUSAL_OF_PARTS = encode_error(UNREAD_REQUEST_ID, "A message has one part, this one has several.")


def _request(fields: Fields, request_id: int) -> Request:
    _check_version(fields)
    op = fields.label("op")
    if op not in OPS:
        raise RequestError(f"op: {op!r} is not one of {', '.join(OPS)}.")
    body = None
    if op in _BODIES or "body" in fields:
        body = fields.inner("body", _BODIES.get(op, lambda _: None))
    fields.end()
    return Request(op, request_id, body)


def _release(fields: Fields) -> Release:
    client = fields.label("client")
    return Release(client, read_finger_key(fields) if "finger" in fields else None, read_stamp(fields))


def _marker(fields: Fields) -> Marker:
    client, text = fields.label("client"), fields.text("text", MAX_MARKER_CHARACTERS)
    return Marker(client, text, has_pulse=fields.boolean("pulse", default=False))


def _reach(fields: Fields) -> ReachQuery:
    if "finger" in fields:
        return ReachQuery(read_finger_key(fields))
    return ReachQuery(None, (_place(fields, "x_mm"), _place(fields, "y_mm")))


def _place(fields: Fields, name: str) -> float:
    return fields.number(name, -MAX_PLACE_MM, MAX_PLACE_MM)


_BODIES: dict[str, Callable[[Fields], Body]] = {
    "set": read_targets,
    "release": _release,
    "marker": _marker,
    "asset": read_asset_part,
    "reach": _reach,
}


# --- telemetry --------------------------------------------------------------------------------------------------


def encode_state(state: PlateState) -> bytes:
    """Encode a message of the `telemetry` socket. Non-finite numbers become nil, which every language can read."""
    return bytes(
        msgpack.packb(
            {
                "v": PROTOCOL_VERSION,
                "instance": state.instance,
                "seq": state.seq,
                "t_ns": state.t_ns,
                "state": state.state,
                "fingers": [_finite_fields(finger) for finger in state.fingers],
                "modal_um": [_finite(w_um.real) for w_um in state.modal_um],
                "modal_q_um": [_finite(w_um.imag) for w_um in state.modal_um],
                "measured_um": [[_finite(w_um.real), _finite(w_um.imag)] for w_um in state.measured_um],
                "limited": state.limited,
                "age_ms": _finite(state.age_ms),
                "horizon_ms": _finite(state.horizon_ms),
                "tick_late_ms": _finite(state.tick_late_ms),
                "missed_ticks": state.missed_ticks,
                "pauses": state.pauses,
                "surfaces_version": state.surfaces_version,
                **_marker_fields(state.markers),
                **({"events": [event_fields(event) for event in state.events]} if state.events else {}),
            }
        )
    )


def _finite_fields(finger: FingerState) -> dict[str, object]:
    fields: dict[str, object] = finger._asdict()
    return {name: _finite(value) if isinstance(value, float) else value for name, value in fields.items()}


def _marker_fields(markers: tuple[Marker, ...]) -> dict[str, object]:
    """The field `markers`, omitted if empty."""
    fields = [{"t_ns": marker.t_ns, "client": marker.client, "text": marker.text} for marker in markers]
    return {"markers": fields} if fields else {}


def event_fields(event: PlateEvent) -> dict[str, object]:
    """The fields of one event; those that it does not have are omitted."""
    fields: dict[str, object] = {"seq": event.seq, "kind": event.kind.value, "t_ns": event.t_ns}
    if event.t_device_ns is not None:
        fields["t_device_ns"] = event.t_device_ns
    if event.finger_id is not None:
        fields["finger"] = event.finger_id
    if event.place_mm is not None:
        fields["x_mm"], fields["y_mm"] = event.place_mm
    return fields | {name: text for name in ("client", "surface", "effect") if (text := getattr(event, name))}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
