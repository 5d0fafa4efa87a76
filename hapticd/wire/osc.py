"""Open Sound Control 1.0: messages with whole numbers, numbers, texts and time tags. Nothing is kept.

By the `python-osc` package, an extra (`osc`), which is imported where a datagram is read or written. It is given single
messages alone, and of these what `_HEAD` matches: in a bundle (1.10) a negative length never ends and 40 kB of bundles
in bundles exhaust its recursion; it logs each type that it does not know, and reads 0 where a number is cut off.
Ten contacts take 0.1 ms to decode so, four times as long as by a compiled decoder of our own; 4 kB take up to 2 ms, so
callers look at an element's address first.
"""

from __future__ import annotations

import re
import struct
from importlib.util import find_spec
from typing import Any, Final, NamedTuple

from ..errors import missing_library

Argument = int | float | str

BUNDLE: Final = b"#bundle\0"
MAX_MESSAGES: Final = 128  # of one datagram: what two TUIO frames of sixteen contacts need
MAX_ARGUMENTS: Final = 256  # of one message: TUIO names all that is there in one
_START: Final = 16  # of a bundle's messages, after its name and its time
_LENGTH: Final = struct.Struct(">I")
_HEAD: Final = re.compile(rb"/[^\0]{0,1023}\0{1,4}(,[ifsthd]{0,%d})\0" % MAX_ARGUMENTS)


class OscError(Exception):
    """A datagram is no message, in a sentence; `reason` is "length" where it ends too early, else "foreign"."""

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason


class OscMessage(NamedTuple):
    """One message. A time tag is a whole number, in ns since 1900."""

    address: str
    arguments: list[Argument]


def require_package() -> None:
    """Raise HapticdError where the `python-osc` package is missing."""
    if find_spec("pythonosc") is None:
        raise missing_library("TUIO and OSC need python-osc", "osc")


def elements(data: bytes) -> list[bytes]:
    """Return the messages of a datagram, not decoded: itself, or those of a bundle and of bundles within it.

    Raises OscError.
    """
    if not data.startswith(BUNDLE):
        return [data]
    found, at = list[bytes](), _START
    if len(data) < _START:
        raise OscError("length", "The OSC bundle ends before its time.")
    while at < len(data):
        if len(data) - at < _LENGTH.size or len(found) == MAX_MESSAGES:
            raise OscError("length", f"The OSC bundle has more than {MAX_MESSAGES} messages, or ends within one.")
        size = _LENGTH.unpack_from(data, at)[0]
        at += _LENGTH.size
        if size > len(data) - at:
            raise OscError("length", "The OSC bundle ends within a message.")
        if size >= _START and data.startswith(BUNDLE, at):
            at += _START  # what it holds follows as if the outer one held it
        else:
            found.append(data[at : at + size])
            at += size
    return found


def decoded(data: bytes) -> OscMessage:
    """Return the message that `data` is. Raises OscError, for a bundle too."""
    from pythonosc.osc_message import OscMessage as Parsed

    head = _HEAD.match(data)
    if head is None or head.start(1) % 4 != 0:
        raise OscError(
            "foreign",
            f"The datagram is no OSC message of an address and at most {MAX_ARGUMENTS} types of i, f, s, t, h and d.",
        )
    count = head.end(1) - head.start(1) - 1
    if len(data) - -(-head.end() // 4) * 4 < 4 * count:
        raise OscError("length", "The OSC message ends too early for its arguments.")
    try:
        parsed = Parsed(data)
    except Exception as error:  # whatever the package makes of bytes
        raise OscError("length", f"The OSC message ends within an argument, or is not UTF-8 ({error}).") from None
    return OscMessage(parsed.address, [_time_ns(*one) if isinstance(one, tuple) else one for one in parsed.params])


def encoded(address: str, *arguments: Argument) -> bytes:
    """Return a message; whole numbers have 32 bits."""
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(address)
    for one in arguments:
        builder.add_arg(one)
    dgram: bytes = builder.build().dgram
    return dgram


def _time_ns(second: Any, fraction: int) -> int:
    """Return the date that the package makes of a time tag, and its fraction in 2^-32 s, in ns since 1900."""
    since = second - second.replace(year=1900, month=1, day=1, hour=0, minute=0, second=0)
    second_s: int = since.days * 86_400 + since.seconds
    return second_s * 1_000_000_000 + (fraction * 1_000_000_000 >> 32)
