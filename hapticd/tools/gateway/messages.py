"""Messages on the gateway's WebSockets: those of `hapticd_contract`, one JSON text each. Pure.

in    a `targets` message          {"v": 1, "client": "page", "targets": [..]}
      a request of `control`       {"v": 1, "id": 7, "op": "hello"}
      which states to send         {"v": 1, "states": "newest"}
out   replies                      {"v": 1, "id": 7, "ok": true, "body": {..}}; id 0 refuses what has no id
      states, as on `telemetry`    {"v": 1, "seq": 512, ..}

Bytes are base64, as in the JSON schemas.
"""

from __future__ import annotations

from typing import Any, Final

import msgspec

from hapticd_contract.base import MAX_MESSAGE_BYTES, PROTOCOL_VERSION
from hapticd_contract.requests import UNREAD_REQUEST_ID, Request
from hapticd_contract.targets import TargetsMessage
from hapticd_contract.web import Follow

from ...errors import RequestError
from ...wire.client import read_message
from ..web.sockets import decoded

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
        value = decoded(text)
        request_id = _id_in(value)
        message: Received = read_message(value, _kind_of(value))
    except RequestError as error:
        raise RefusedMessage(str(error), request_id) from None
    return message


def encode(message: TargetsMessage | Request) -> bytes:
    """Encode for the daemon's socket. Raises RefusedMessage for what is too long there."""
    payload = _ENCODER.encode(message)
    if len(payload) > MAX_MESSAGE_BYTES:
        raise RefusedMessage(f"The message has {len(payload)} bytes, the limit is {MAX_MESSAGE_BYTES}.", id_of(message))
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


def id_of(message: TargetsMessage | Request) -> int:
    """Return the id of the reply to a message."""
    return UNREAD_REQUEST_ID if isinstance(message, TargetsMessage) else message.id


def _kind_of(value: object) -> Any:
    if isinstance(value, dict) and "op" in value:
        return Request
    return Follow if isinstance(value, dict) and "states" in value else TargetsMessage


def _id_in(value: object) -> int:
    found = value.get("id") if isinstance(value, dict) else None
    return found if type(found) is int and 0 < found < 2**32 else UNREAD_REQUEST_ID
