"""Requests, replies and states, as clients/PROTOCOL.md has them. Fields that a newer daemon adds are ignored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgpack

from .errors import HapticdError, RefusedError

PROTOCOL_VERSION = 1
UNREAD_REQUEST_ID = 0  # of the reply to a request whose id the daemon could not read
STRANGER = "What answers at this endpoint does not speak hapticd's protocol."


@dataclass(frozen=True, slots=True)
class FingerState:
    """One finger: where it was last seen, where it will be when the plate moves, what it should get and gets.

    Positions are mm from the plate's centre, x to the right and y away from the user; amplitudes um peak to peak.
    None: nothing was computed, as for a finger that nobody wants. `virtual` fingers have a name for an id. `owner` is
    the client that holds it, None also of a daemon that does not tell.
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


@dataclass(frozen=True, slots=True)
class Marker:
    """What some client noted of its experiment with `Client.marker`, and when: `t_ns` as in PlateState."""

    t_ns: int
    client: str
    text: str


@dataclass(frozen=True, slots=True)
class PlateState:
    """What the plate did at one instant, for all its fingers.

    `t_ns` is the host's monotonic clock and `seq` counts the messages of one daemon; `instance` changes when the
    daemon restarts. `limited` says that some target was missed because a mode met its limit, `condition` how hard
    the fingers are to tell apart (None: not computed, or impossible). `age_ms` is the age of the newest touch sample,
    `horizon_ms` how far ahead of it the plate was driven. `modal_um` and `modal_q_um` are the real and imaginary parts
    of the modes' phasors, `measured_um` what the board last measured of them; an older daemon tells neither of the two.
    `markers` came since the message before: a reader that skips messages misses those in them.
    """

    instance: int
    seq: int
    t_ns: int
    state: str
    fingers: tuple[FingerState, ...]
    modal_um: tuple[float, ...]
    limited: bool
    condition: float | None
    age_ms: float
    horizon_ms: float
    markers: tuple[Marker, ...] = ()
    modal_q_um: tuple[float, ...] = ()
    measured_um: tuple[complex, ...] = ()


def encode_request(op: str, request_id: int, body: Mapping[str, object] | None) -> bytes:
    """A message for the `control` socket."""
    request: dict[str, object] = {"v": PROTOCOL_VERSION, "id": request_id, "op": op}
    if body is not None:
        request["body"] = dict(body)
    return bytes(msgpack.packb(request))


def read_reply(payload: bytes, request_id: int) -> dict[str, Any] | None:
    """The body of the reply to this request; None for a late reply to another. Raises RefusedError with the reason,
    and HapticdError where it is no reply."""
    reply = _unpacked(payload)
    reply_id = reply.get("id")
    if type(reply_id) is not int:
        raise HapticdError(STRANGER)
    if reply_id not in (request_id, UNREAD_REQUEST_ID):
        return None
    if reply.get("ok") is True:
        body = reply.get("body")
        return dict(body) if isinstance(body, dict) else {}
    raise RefusedError(str(reply.get("error", "The daemon refused the request and gave no reason.")))


def decode_state(payload: bytes) -> PlateState:
    """A message of the `telemetry` socket. Raises HapticdError where it is not one of this version."""
    fields = _unpacked(payload)
    if fields.get("v") != PROTOCOL_VERSION:
        raise HapticdError(
            f"The daemon's states are of protocol version {fields.get('v')}, this library reads {PROTOCOL_VERSION}: "
            "install the hapticd-client that belongs to the daemon."
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
            condition=fields["condition"],
            age_ms=_number(fields["age_ms"]),
            horizon_ms=_number(fields["horizon_ms"]),
            markers=tuple(Marker(one["t_ns"], one["client"], one["text"]) for one in fields.get("markers", ())),
            modal_q_um=tuple(_number(w_um) for w_um in fields.get("modal_q_um", ())),
            measured_um=tuple(complex(_number(d), _number(q)) for d, q in fields.get("measured_um", ())),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise HapticdError(f"The daemon sent a state that cannot be read ({error}).") from None


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
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _unpacked(payload: bytes) -> dict[str, Any]:
    try:
        message = msgpack.unpackb(payload)
    except (ValueError, msgpack.UnpackException):
        message = None
    if not isinstance(message, dict):
        raise HapticdError(STRANGER)
    return message
