"""Client messages, one MessagePack map each. What is in them is `hapticd_contract`; here are the bytes.

    targets    client -> daemon   decode_targets    all targets of one client
    control    client -> daemon   decode_request    a request with an id; encode_reply or encode_error answers it
    telemetry  daemon -> clients  encode_state      the state of every finger

Decoders raise RequestError, with one sentence for the sender, and nothing else for any bytes. msgspec decodes into the
contract's types; what it refuses, and messages in which a map may have the same key twice, msgpack unpacks once more,
for the sentence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgpack
import msgspec
from msgspec import Struct

from hapticd_contract.base import MAX_MESSAGE_BYTES, PROTOCOL_VERSION
from hapticd_contract.requests import UNREAD_REQUEST_ID, Request
from hapticd_contract.sentences import ContractError, check, converted
from hapticd_contract.states import PlateState
from hapticd_contract.targets import ClientTargets, TargetsMessage

from ..errors import RequestError

_TARGETS: Final = msgspec.msgpack.Decoder(TargetsMessage)
_REQUEST: Final[msgspec.msgpack.Decoder[Request]] = msgspec.msgpack.Decoder(Request)
_ANY: Final = msgspec.msgpack.Decoder()
_ENCODER: Final = msgspec.msgpack.Encoder()
_NOT_PACKED: Final = (ValueError, TypeError, RecursionError, msgspec.MsgspecError, msgpack.UnpackException)


def decode_targets(payload: bytes) -> ClientTargets:
    """Decode a message of the `targets` socket. Raises RequestError."""
    message: ClientTargets = _decoded(payload, _TARGETS)
    return message


def decode_request(payload: bytes) -> Request:
    """Decode a message of the `control` socket. Raises RequestError."""
    request: Request = _decoded(payload, _REQUEST)
    return request


def encode_targets(message: ClientTargets) -> bytes:
    """Encode a message of the `targets` socket."""
    fields = msgspec.structs.asdict(message)
    return _ENCODER.encode(TargetsMessage(**{**fields, "v": PROTOCOL_VERSION}))


def answer(payload: bytes, handle: Callable[[Request], Struct | Mapping[str, object]]) -> bytes:
    """Return the reply to a control message: the result of `handle`, or the sentence of a RequestError."""
    try:
        request = decode_request(payload)
        return encode_reply(request.id, handle(request))
    except RequestError as error:
        request_id = peek_whole(payload, "id") or UNREAD_REQUEST_ID
        return encode_error(request_id if 0 < request_id < 2**32 else UNREAD_REQUEST_ID, str(error))


def encode_reply(request_id: int, body: Struct | Mapping[str, object]) -> bytes:
    """Encode the reply to a successful request. `body` is one of the contract, or plain values in maps."""
    return _ENCODER.encode({"v": PROTOCOL_VERSION, "id": request_id, "ok": True, "body": body})


def encode_error(request_id: int, sentence: str) -> bytes:
    """Encode the reply to a refused request."""
    return _ENCODER.encode({"v": PROTOCOL_VERSION, "id": request_id, "ok": False, "error": sentence})


REFUSAL_OF_PARTS: Final = encode_error(UNREAD_REQUEST_ID, "A message has one part, this one has several.")

# --- bytes ------------------------------------------------------------------------------------------------------


def _decoded(payload: bytes, decoder: msgspec.msgpack.Decoder[Any]) -> Any:
    if len(payload) <= MAX_MESSAGE_BYTES:
        try:
            message = decoder.decode(payload)
            if _ENCODER.encode(_ANY.decode(payload)) == payload:  # so no map has a key twice
                check(message)
                return message
        except ContractError as error:
            raise RequestError(str(error)) from None
        except _NOT_PACKED:
            pass
    return _explained(payload, decoder.type)


def _explained(payload: bytes, kind: Any) -> Any:
    """Decode slowly: a sound message may be packed in more bytes than it needs."""
    return read_message(unpack(payload), kind)


def read_message(value: object, kind: Any) -> Any:
    """Return plain values as a message of this protocol version. Raises RequestError."""
    if isinstance(value, dict) and type(version := value.get("v")) is int and version != PROTOCOL_VERSION:
        older = "client" if version < PROTOCOL_VERSION else "daemon"
        raise RequestError(
            f"The message has protocol version {version}, the daemon has {PROTOCOL_VERSION}: update the {older}."
        )
    return read(value, kind)


def read(value: object, kind: Any, where: str = "") -> Any:
    """Return plain values as a type of the contract. Raises RequestError."""
    try:
        return converted(value, kind, where)
    except ContractError as error:
        raise RequestError(str(error)) from None


def unpack(payload: bytes) -> object:
    """Unpack one MessagePack value, whose maps have distinct keys. Raises RequestError."""
    if len(payload) > MAX_MESSAGE_BYTES:
        raise RequestError(f"The message has {len(payload)} bytes, the limit is {MAX_MESSAGE_BYTES}.")
    try:
        return msgpack.unpackb(payload, raw=False, strict_map_key=True, object_pairs_hook=distinct, max_ext_len=0)
    except RequestError:
        raise
    except _NOT_PACKED as error:
        reason = str(error).rstrip(".") or type(error).__name__
        raise RequestError(f"The message ({len(payload)} bytes) is not valid MessagePack: {reason}.") from None


def peek_whole(payload: bytes, name: str) -> int | None:
    """Return a whole number of a message that `unpack` refuses, so that its sender gets an answer; None without one."""
    unpacker = msgpack.Unpacker(raw=False, strict_map_key=True, max_buffer_size=MAX_MESSAGE_BYTES, max_ext_len=0)
    try:
        unpacker.feed(payload)
        for _ in range(unpacker.read_map_header()):
            if unpacker.unpack() == name:
                value = unpacker.unpack()
                return value if type(value) is int else None
            unpacker.skip()
    except _NOT_PACKED:
        pass
    return None


def distinct(pairs: list[tuple[object, object]]) -> dict[object, object]:
    """Build a map; refuse duplicate keys, which two readers may resolve differently. Raises RequestError."""
    table = dict(pairs)
    if len(table) != len(pairs):
        raise RequestError("The message contains a map with the same key twice.")
    return table


# --- telemetry --------------------------------------------------------------------------------------------------

_MAYBE_NOT_FINITE: Final = re.compile(rb"\xcb[\x7f\xff][\xf0-\xff]")  # the first bytes of NaN and infinities


def encode_state(state: PlateState) -> bytes:
    """Encode a message of the `telemetry` socket. Non-finite numbers become nil, which every language can read."""
    payload = _ENCODER.encode(state)
    if _MAYBE_NOT_FINITE.search(payload) is None:
        return payload
    return _ENCODER.encode(_finite(_ANY.decode(payload)))


def _finite(value: object) -> object:
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
