"""OSC 1.0 messages: an address, and arguments that are whole numbers, numbers and texts. Pure."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from ...errors import RequestError

MAX_DATAGRAM_BYTES: Final = 1024
Argument = int | float | str


class OscMessage(NamedTuple):
    """One message."""

    address: str
    arguments: tuple[Argument, ...]


def decode_osc(datagram: bytes) -> OscMessage:
    """Decode a datagram with one message. Raises RequestError."""
    if len(datagram) > MAX_DATAGRAM_BYTES:
        raise RequestError(f"The datagram has {len(datagram)} bytes, the limit is {MAX_DATAGRAM_BYTES}.")
    address, at = _text(datagram, 0)
    if not address.startswith("/"):
        raise RequestError("The datagram is no OSC message: bundles are not taken.")
    types, at = _text(datagram, at)
    if not types.startswith(","):
        raise RequestError("The OSC message has no types: it is of an old sender.")
    arguments: list[Argument] = []
    for kind in types[1:]:
        if kind == "s":
            text, at = _text(datagram, at)
            arguments.append(text)
        elif kind in "if" and at + 4 <= len(datagram):
            arguments.append(struct.unpack_from(f">{kind}", datagram, at)[0])
            at += 4
        else:
            raise RequestError("The OSC message ends too early, or has an argument that is not of type i, f or s.")
    return OscMessage(address, tuple(arguments))


def encode_osc(address: str, *arguments: Argument) -> bytes:
    """Encode a message; whole numbers have 32 bits."""
    types, data = ",", b""
    for one in arguments:
        if isinstance(one, str):
            types, data = types + "s", data + _padded(one)
        elif isinstance(one, int):
            types, data = types + "i", data + struct.pack(">i", one)
        else:
            types, data = types + "f", data + struct.pack(">f", one)
    return _padded(address) + _padded(types) + data


def _padded(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return raw + bytes(-len(raw) % 4)


def _text(datagram: bytes, at: int) -> tuple[str, int]:
    end = datagram.find(b"\0", at)
    if end < 0:
        raise RequestError("The OSC message ends within a text.")
    try:
        return datagram[at:end].decode(), end + 4 - end % 4
    except UnicodeDecodeError:
        raise RequestError("The OSC message has a text that is not UTF-8.") from None
