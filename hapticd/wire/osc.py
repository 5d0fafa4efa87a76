"""Open Sound Control 1.0: messages with whole numbers, numbers, texts and time tags. Nothing is kept.

Lengths are checked before anything is cut out; an argument whose type is not known ends the message, not the decoder.
The `python-osc` package (1.10) is not used: 40 kB of bundles in bundles, which any sender may send, exhaust its
recursion.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

Argument = int | float | str

BUNDLE: Final = b"#bundle\0"
MAX_MESSAGES: Final = 128  # of one datagram: what two TUIO frames of sixteen contacts need
MAX_ARGUMENTS: Final = 32
MAX_TEXT_BYTES: Final = 1024
_INT, _FLOAT, _LENGTH, _TIME = struct.Struct(">i"), struct.Struct(">f"), struct.Struct(">I"), struct.Struct(">II")
_HEAD: Final = 16  # of a bundle: its name and its time


class OscError(Exception):
    """A datagram is no message, in a sentence; `reason` is "length" where it ends too early, else "foreign"."""

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason


class OscMessage(NamedTuple):
    """One message. A time tag is a whole number, in ns since 1900; what is not UTF-8 of a text is U+FFFD."""

    address: str
    arguments: list[Argument]


def messages(data: bytes) -> list[OscMessage]:
    """Return the messages of a datagram: one, or those of a bundle. Raises OscError."""
    if not data.startswith(BUNDLE):
        return [decoded(data)]
    found, at = list[OscMessage](), _HEAD
    if len(data) < _HEAD:
        raise OscError("length", "The OSC bundle ends before its time.")
    while at < len(data):
        if len(data) - at < _LENGTH.size or len(found) == MAX_MESSAGES:
            raise OscError("length", f"The OSC bundle has more than {MAX_MESSAGES} messages, or ends within one.")
        size = _LENGTH.unpack_from(data, at)[0]
        at += _LENGTH.size
        if size > len(data) - at:
            raise OscError("length", "The OSC bundle ends within a message.")
        found.append(decoded(data[at : at + size]))  # a bundle in a bundle is no message here
        at += size
    return found


def decoded(data: bytes) -> OscMessage:
    """Return the message that `data` is. Raises OscError, for a bundle too."""
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise OscError("foreign", "The datagram is no OSC message: its address must begin with a slash.")
    types, at = _text(data, at)
    if not types.startswith(",") or len(types) > MAX_ARGUMENTS + 1:
        raise OscError("foreign", f"The OSC message has no types, or more than {MAX_ARGUMENTS} arguments.")
    arguments: list[Argument] = []
    for kind in types[1:]:
        if kind == "s":
            text, at = _text(data, at)
            arguments.append(text)
            continue
        if kind not in "ift":
            raise OscError("foreign", "The OSC message has an argument that is not of type i, f, s or t.")
        if at + (8 if kind == "t" else 4) > len(data):
            raise OscError("length", "The OSC message ends too early for its arguments.")
        if kind == "t":
            seconds_s, fraction = _TIME.unpack_from(data, at)
            arguments.append(seconds_s * 1_000_000_000 + (fraction * 1_000_000_000 >> 32))
            at += 8
        else:
            arguments.append(_INT.unpack_from(data, at)[0] if kind == "i" else _FLOAT.unpack_from(data, at)[0])
            at += 4
    return OscMessage(address, arguments)


def encoded(address: str, *arguments: Argument) -> bytes:
    """Return a message; whole numbers have 32 bits."""
    types, data = ",", b""
    for one in arguments:
        if isinstance(one, str):
            types, data = types + "s", data + _padded(one)
        elif isinstance(one, int):
            types, data = types + "i", data + _INT.pack(one)
        else:
            types, data = types + "f", data + _FLOAT.pack(one)
    return _padded(address) + _padded(types) + data


def _padded(text: str) -> bytes:
    data = text.encode() + b"\0"
    return data + bytes(-len(data) % 4)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return a text that ends in a zero, and where the next value begins: at a multiple of four bytes."""
    end = data.find(b"\0", at, at + MAX_TEXT_BYTES)
    if end < 0:
        raise OscError("length", "The OSC message ends within a text.")
    return data[at:end].decode(errors="replace"), at + ((end - at) // 4 + 1) * 4
