"""Requests, replies and states of clients/PROTOCOL.md. Unknown fields of a newer daemon are ignored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgpack

from .errors import HapticdError, RefusedError

PROTOCOL_VERSION = 1
UNREAD_REQUEST_ID = 0  # id of the reply to a request whose id could not be read
NOT_HAPTICD = "The program at this endpoint does not use hapticd's protocol: check the endpoint."


@dataclass(frozen=True, slots=True)
class FingerState:
    """One finger: last measured and predicted position, target and achieved amplitude.

    Positions are mm from the plate's centre, x to the right and y away from the user; amplitudes um peak to peak.
    None: not computed, as for a finger without a target. The id of a `virtual` finger is its name. `owner` is the
    client that owns it. What it feels is as of the newest touch sample: `felt_friction` is the mean friction over its
    contact, from 0, the most slippery, to 1, bare glass, as in `Client.set`; `contact_um` the RMS amplitude there;
    `friction_change` the friction relative to what was asked, minus 1, both relative to bare glass; `error_jnd` the
    same in just noticeable differences (None on plates that are driven for points), and `weber_frac` the share of time
    in which it was beyond one. An older daemon sends none of these.
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


@dataclass(frozen=True, slots=True)
class Marker:
    """A marker of an experiment, set with `Client.marker`; `t_ns` as in PlateState."""

    t_ns: int
    client: str
    text: str


@dataclass(frozen=True, slots=True)
class PlateEvent:
    """What happened to a finger or an effect; `seq` counts all events of one daemon, so that a gap is a lost one.

    `kind` is "landed", "lifted", "entered", "left", "crossed", "pressed", "released", "begun" or "ended". `t_ns` is
    when its cause occurred, as in PlateState, `t_device_ns` the same on the trackpad's own clock; crossings are
    predicted. `client` owns the `surface` or `effect`; None and "" where there is none.
    """

    seq: int
    kind: str
    t_ns: int
    t_device_ns: int | None = None
    finger: int | None = None
    x_mm: float | None = None
    y_mm: float | None = None
    client: str = ""
    surface: str = ""
    effect: str = ""


@dataclass(frozen=True, slots=True)
class PlateState:
    """The state of the plate and all fingers at one instant.

    `t_ns` is the host's monotonic clock and `seq` counts the messages of one daemon; `instance` changes when the
    daemon restarts. `limited`: a mode reached its limit, so that some target was missed. `age_ms` is
    the age of the newest touch sample,
    `horizon_ms` how far ahead of it the plate was driven. `modal_um` and `modal_q_um` are the real and imaginary parts
    of the modes' phasors, `measured_um` the board's last measurement; an older daemon sends neither of the two.
    `markers` and `events` came since the previous message: a reader that skips messages misses them.
    `surfaces_version` counts the changes of the surfaces in force (`Client.surfaces`); None from an older daemon.
    """

    instance: int
    seq: int
    t_ns: int
    state: str
    fingers: tuple[FingerState, ...]
    modal_um: tuple[float, ...]
    limited: bool
    age_ms: float
    horizon_ms: float
    markers: tuple[Marker, ...] = ()
    modal_q_um: tuple[float, ...] = ()
    measured_um: tuple[complex, ...] = ()
    surfaces_version: int | None = None
    events: tuple[PlateEvent, ...] = ()


def encode_request(op: str, request_id: int, body: Mapping[str, object] | None) -> bytes:
    """Encode a message for the `control` socket."""
    request: dict[str, object] = {"v": PROTOCOL_VERSION, "id": request_id, "op": op}
    if body is not None:
        request["body"] = dict(body)
    return bytes(msgpack.packb(request))


def read_reply(payload: bytes, request_id: int) -> dict[str, Any] | None:
    """Decode a reply: its body, or None for a late reply to another request.

    Raises RefusedError with the daemon's reason, HapticdError if it is no reply.
    """
    reply = _unpacked(payload)
    reply_id = reply.get("id")
    if type(reply_id) is not int:
        raise HapticdError(NOT_HAPTICD)
    if reply_id not in (request_id, UNREAD_REQUEST_ID):
        return None
    if reply.get("ok") is True:
        body = reply.get("body")
        return dict(body) if isinstance(body, dict) else {}
    raise RefusedError(_printable(str(reply.get("error", "The daemon refused the request and gave no reason."))))


def _printable(text: str) -> str:
    """Escape what a terminal would obey."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)


def decode_state(payload: bytes) -> PlateState:
    """Decode a message of the `telemetry` socket. Raises HapticdError for another version or an invalid message."""
    fields = _unpacked(payload)
    if fields.get("v") != PROTOCOL_VERSION:
        raise HapticdError(
            f"The daemon's states have protocol version {fields.get('v')!r}, this library {PROTOCOL_VERSION}: "
            "install the hapticd-client of the daemon's version."
        )
    try:
        return PlateState(
            instance=fields["instance"],
            seq=fields["seq"],
            t_ns=fields["t_ns"],
            state=fields["state"],
            fingers=tuple(_finger_state(finger) for finger in fields["fingers"]),
            modal_um=tuple(_number(w_um) for w_um in fields["modal_um"]),
            limited=fields["limited"],
            age_ms=_number(fields["age_ms"]),
            horizon_ms=_number(fields["horizon_ms"]),
            markers=tuple(Marker(one["t_ns"], one["client"], one["text"]) for one in fields.get("markers", ())),
            modal_q_um=tuple(_number(w_um) for w_um in fields.get("modal_q_um", ())),
            measured_um=tuple(complex(_number(d), _number(q)) for d, q in fields.get("measured_um", ())),
            surfaces_version=fields.get("surfaces_version"),
            events=tuple(_event(one) for one in fields.get("events", ())),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise HapticdError(f"The daemon sent an invalid state ({error}).") from None


def _finger_state(finger: dict[str, Any]) -> FingerState:
    return FingerState(
        id=finger["id"],
        x_mm=_number(finger["x_mm"]),
        y_mm=_number(finger["y_mm"]),
        predicted_x_mm=finger["predicted_x_mm"],
        predicted_y_mm=finger["predicted_y_mm"],
        target_um=finger["target_um"],
        achieved_um=finger["achieved_um"],
        virtual=finger["virtual"],
        owner=finger.get("owner"),
        friction_change=finger.get("friction_change"),
        weber_frac=finger.get("weber_frac"),
        contact_um=finger.get("contact_um"),
        felt_friction=finger.get("felt_friction"),
        error_jnd=finger.get("error_jnd"),
    )


def _event(fields: dict[str, Any]) -> PlateEvent:
    return PlateEvent(
        seq=fields["seq"],
        kind=fields["kind"],
        t_ns=fields["t_ns"],
        t_device_ns=fields.get("t_device_ns"),
        finger=fields.get("finger"),
        x_mm=fields.get("x_mm"),
        y_mm=fields.get("y_mm"),
        client=fields.get("client", ""),
        surface=fields.get("surface", ""),
        effect=fields.get("effect", ""),
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _unpacked(payload: bytes) -> dict[str, Any]:
    try:
        message = msgpack.unpackb(payload)
    except (ValueError, msgpack.UnpackException):
        message = None
    if not isinstance(message, dict):
        raise HapticdError(NOT_HAPTICD)
    return message
