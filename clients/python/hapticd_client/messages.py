"""Bytes of requests, replies and states; what is in them is `hapticd_contract`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import msgspec

from hapticd_contract.base import PROTOCOL_VERSION
from hapticd_contract.requests import UNREAD_REQUEST_ID
from hapticd_contract.states import FingerState, PlateState

from .errors import HapticdError, RefusedError

NOT_HAPTICD = "The program at this endpoint does not use hapticd's protocol: check the endpoint."

_STATE = msgspec.msgpack.Decoder(PlateState)


def encode_request(op: str, request_id: int, body: object) -> bytes:
    """Encode a message for the `control` socket; `body` is one of the contract, or plain values in maps."""
    request: dict[str, object] = {"v": PROTOCOL_VERSION, "id": request_id, "op": op}
    if body is not None:
        request["body"] = body
    return msgspec.msgpack.encode(request)


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
    raise RefusedError(printable(str(reply.get("error", "The daemon refused the request and gave no reason."))))


def printable(text: str) -> str:
    """Escape what a terminal would obey."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)


def decode_state(payload: bytes) -> PlateState:
    """Decode a message of the `telemetry` socket. Raises HapticdError for another version or an invalid message."""
    try:
        return _STATE.decode(payload)
    except (ValueError, RecursionError, msgspec.MsgspecError):
        fields = _unpacked(payload)
    version = fields.get("v")
    if version != PROTOCOL_VERSION:
        raise HapticdError(
            f"The daemon's states have protocol version {version!r}, this library {PROTOCOL_VERSION}: "
            "install the hapticd-client of the daemon's version."
        )
    try:
        fingers = [_with_nan(finger, FingerState) for finger in fields["fingers"]]
        return msgspec.convert(_with_nan({**fields, "fingers": fingers}, PlateState), PlateState)
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise HapticdError(f"The daemon sent an invalid state ({error}).") from None


def _with_nan(fields: Mapping[str, Any], kind: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the fields of a message with NaN for nil, where there is a number that was not finite."""
    made = {name: _nan_for_nil(value) if isinstance(value, list) else value for name, value in fields.items()}
    return made | {name: math.nan for name in _numbers(kind) if name in made and made[name] is None}


@lru_cache
def _numbers(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """Return the fields that are a number and never nil by themselves."""
    return tuple(field.encode_name for field in msgspec.structs.fields(kind) if field.type is float)


def _nan_for_nil(value: Any) -> Any:
    if isinstance(value, list):
        return [_nan_for_nil(one) for one in value]
    return math.nan if value is None else value


def _unpacked(payload: bytes) -> dict[str, Any]:
    try:
        message = msgspec.msgpack.decode(payload)
    except (ValueError, TypeError, RecursionError, msgspec.MsgspecError):
        message = None
    if not isinstance(message, dict):
        raise HapticdError(NOT_HAPTICD)
    return message
