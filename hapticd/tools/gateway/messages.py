"""Messages on the gateway's WebSockets: those of `hapticd_contract`, one JSON text each. Pure.

in    a `targets` message          {"v": 1, "client": "page", "targets": [..]}
      a request of `control`       {"v": 1, "id": 7, "op": "hello"}
      which states to send         {"v": 1, "states": "newest"}
out   replies                      {"v": 1, "id": 7, "ok": true, "body": {..}}; id 0 refuses what has no id
      states, as on `telemetry`    {"v": 1, "seq": 512, ..}

Bytes are base64, as in the JSON schemas.
"""

from __future__ import annotations

import binascii
import json
from functools import cache
from typing import Any, Final, NoReturn

import msgspec
from msgspec import inspect as types

from hapticd_contract.base import MAX_MESSAGE_BYTES, PROTOCOL_VERSION
from hapticd_contract.requests import UNREAD_REQUEST_ID, Request
from hapticd_contract.targets import TargetsMessage
from hapticd_contract.web import Follow

from ...errors import RequestError
from ...wire.client import distinct, read_message

MAX_TEXT_BYTES: Final = 2 * MAX_MESSAGE_BYTES  # JSON is longer than MessagePack

Received = TargetsMessage | Request | Follow
_ENCODER: Final = msgspec.msgpack.Encoder()
_DECODER: Final = msgspec.msgpack.Decoder()


class RefusedMessage(RequestError):
    """A message was refused; `request_id` is that of the reply."""

    def __init__(self, sentence: str, request_id: int = UNREAD_REQUEST_ID) -> None:
        super().__init__(sentence)
        self.request_id = request_id


def decode(text: str) -> Received:
    """Decode a text of a peer. Raises RefusedMessage."""
    request_id = UNREAD_REQUEST_ID
    try:
        value = json.loads(text, object_pairs_hook=distinct, parse_constant=_not_finite)
        request_id = _id_of(value)
        message: Received = read_message(_with_bytes(value), _kind_of(value))
    except RequestError as error:
        raise RefusedMessage(str(error), request_id) from None
    except (ValueError, RecursionError):
        raise RefusedMessage("The message is not JSON, or too deep.") from None
    return message


def encode(message: TargetsMessage | Request) -> bytes:
    """Encode for the daemon's socket. Raises RefusedMessage for what is too long there."""
    payload = _ENCODER.encode(message)
    if len(payload) > MAX_MESSAGE_BYTES:
        request_id = UNREAD_REQUEST_ID if isinstance(message, TargetsMessage) else message.id
        raise RefusedMessage(f"The message has {len(payload)} bytes, the limit is {MAX_MESSAGE_BYTES}.", request_id)
    return payload


def client_of(message: TargetsMessage | Request) -> str | None:
    """Return the client's name in a message, None where it has none."""
    named = message if isinstance(message, TargetsMessage) else message.body
    name: str | None = getattr(named, "client", None)
    return name


def text_of(payload: bytes) -> str:
    """Return a message of the daemon as JSON."""
    return msgspec.json.encode(_DECODER.decode(payload)).decode()


def refusal(sentence: str, request_id: int = UNREAD_REQUEST_ID) -> str:
    """Return the reply to a message that the daemon never gets."""
    fields = {"v": PROTOCOL_VERSION, "id": request_id, "ok": False, "error": sentence}
    return msgspec.json.encode(fields).decode()


def _kind_of(value: object) -> Any:
    if isinstance(value, dict) and "op" in value:
        return Request
    return Follow if isinstance(value, dict) and "states" in value else TargetsMessage


def _id_of(value: object) -> int:
    found = value.get("id") if isinstance(value, dict) else None
    return found if type(found) is int and 0 < found < 2**32 else UNREAD_REQUEST_ID


def _with_bytes(value: Any) -> Any:
    if isinstance(value, list):
        return [_with_bytes(one) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        name: _bytes_of(name, one) if name in byte_fields() and isinstance(one, str) else _with_bytes(one)
        for name, one in value.items()
    }


def _bytes_of(name: str, text: str) -> bytes:
    try:
        return binascii.a2b_base64(text, strict_mode=True)
    except ValueError:  # also of what is not ASCII
        raise RequestError(f"{name}: must be bytes as base64.") from None


@cache
def byte_fields() -> frozenset[str]:
    """Return the names of all fields of the contract that hold bytes; a field of such a name never holds a text."""
    found: set[str] = set()
    seen: set[type] = set()

    def walk(form: Any, name: str = "") -> None:
        if isinstance(form, types.BytesType):
            found.add(name)
        elif isinstance(form, types.StructType) and form.cls not in seen:
            seen.add(form.cls)
            for field in form.fields:
                walk(field.type, field.encode_name)
        inner = [*getattr(form, "types", ()), *getattr(form, "item_types", ()), getattr(form, "item_type", None)]
        for one in filter(None, inner):
            walk(one, name)

    walk(types.type_info(Request))  # `set` holds all of a `targets` message
    return frozenset(found)


def _not_finite(name: str) -> NoReturn:
    raise RequestError(f"The message contains {name}, which is no number of JSON.")
