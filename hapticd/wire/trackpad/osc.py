"""Open Sound Control 1.0, as far as TUIO needs it: a datagram's messages, or a refusal. Nothing is kept.

Lengths are checked before anything is cut out; what is not known of a type ends the message, not the decoder.
"""

from __future__ import annotations

import struct
from typing import Final

from .records import RefusedError

TuioValue = int | float | str
TuioMessage = tuple[str, list[TuioValue]]

BUNDLE: Final = b"#bundle\0"
MAX_MESSAGES: Final = 128  # of one datagram: what two frames of sixteen contacts need
MAX_ARGUMENTS: Final = 32
_MAX_TEXT: Final = 128
_INT, _FLOAT, _LENGTH, _TIME = struct.Struct(">i"), struct.Struct(">f"), struct.Struct(">I"), struct.Struct(">II")
_HEAD: Final = 16  # of a bundle: its name and its time


def messages(data: bytes) -> list[TuioMessage]:
    """Return the messages of a datagram: one, or those of a bundle. Raises RefusedError."""
    if not data.startswith(BUNDLE):
        return [_message(data)]
    found, at = list[TuioMessage](), _HEAD
    if len(data) < _HEAD:
        raise RefusedError("length")
    while at < len(data):
        if len(data) - at < _LENGTH.size or len(found) == MAX_MESSAGES:
            raise RefusedError("length")
        size = _LENGTH.unpack_from(data, at)[0]
        at += _LENGTH.size
        if size > len(data) - at:
            raise RefusedError("length")
        found.append(_message(data[at : at + size]))  # a bundle in a bundle is no message: TUIO has none
        at += size
    return found


def _message(data: bytes) -> TuioMessage:
    address, at = _text(data, 0)
    types, at = _text(data, at)
    if not (address.startswith("/") and types.startswith(",") and len(types) <= MAX_ARGUMENTS + 1):
        raise RefusedError("foreign")
    arguments: list[TuioValue] = []
    for kind in types[1:]:
        if kind == "s":
            text, at = _text(data, at)
            arguments.append(text)
            continue
        if kind not in "ift":
            raise RefusedError("foreign")
        if at + (8 if kind == "t" else 4) > len(data):
            raise RefusedError("length")
        if kind == "t":
            seconds_s, fraction = _TIME.unpack_from(data, at)
            arguments.append(seconds_s * 1_000_000_000 + (fraction * 1_000_000_000 >> 32))
            at += 8
        else:
            arguments.append(_INT.unpack_from(data, at)[0] if kind == "i" else _FLOAT.unpack_from(data, at)[0])
            at += 4
    return address, arguments


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return a text that ends in a zero, and where the next value begins: at a multiple of four bytes."""
    end = data.find(b"\0", at, at + _MAX_TEXT)
    if end < 0:
        raise RefusedError("length")
    return data[at:end].decode("ascii", errors="replace"), at + ((end - at) // 4 + 1) * 4
