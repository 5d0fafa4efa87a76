"""Frames on a serial line: COBS (Cheshire and Baker, 1999), CRC-16/CCITT-FALSE, delimiter 0x00.

The CRC covers the message and follows it, little endian. COBS replaces every zero byte, so the delimiter is
unambiguous and a damaged frame loses only itself.
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import Final

_CRC_START: Final = 0xFFFF
_BLOCK_MAX: Final = 254  # bytes that a block can hold; after such a block no zero is implied
_CODES: Final = [bytes((length + 1,)) for length in range(_BLOCK_MAX + 1)]
_EMPTY: Final = _CODES[0]


def encode_frame(message: bytes) -> bytes:
    """Encode message, CRC and delimiter for the line."""
    body = message + crc_hqx(message, _CRC_START).to_bytes(2, "little")
    if len(body) >= _BLOCK_MAX:
        return b"".join(_blocks(body.split(b"\0"))) + b"\0"
    # The usual case: each run between zeros is a block, and most are empty.
    return b"".join([_CODES[len(run)] + run if run else _EMPTY for run in body.split(b"\0")]) + b"\0"


def _blocks(runs: list[bytes]) -> list[bytes]:
    """Split runs between zeros into blocks of at most _BLOCK_MAX bytes."""
    blocks: list[bytes] = []
    for run in runs:
        while len(run) > _BLOCK_MAX:
            blocks += (_CODES[_BLOCK_MAX], run[:_BLOCK_MAX])
            run = run[_BLOCK_MAX:]
        blocks += (_CODES[len(run)], run)
        if len(run) == _BLOCK_MAX:
            blocks.append(_CODES[0])  # a full block implies no zero
    if len(run) == _BLOCK_MAX:
        blocks.pop()  # no zero follows the last run
    return blocks


class FrameSplitter:
    """Split bytes, in pieces of any size, into whole valid messages; `counters` counts the others by reason."""

    def __init__(self, max_bytes: int) -> None:
        self.counters = {"oversize": 0, "cobs": 0, "crc": 0}
        self._max_bytes = max_bytes  # of an encoded frame: longer ones are skipped
        self._rest = b""  # of a frame that has not ended

    def feed(self, data: bytes) -> list[bytes]:
        """Return the messages completed by `data`, without CRC, in order; each has at least one byte."""
        *closed, rest = (self._rest + data).split(b"\0")
        self._rest = rest[: self._max_bytes + 1]  # of one that is too long, as much as shows it
        messages = [self._message(encoded) for encoded in closed if encoded]
        return [message for message in messages if message is not None]

    def _message(self, encoded: bytes) -> bytes | None:
        if len(encoded) > self._max_bytes:
            self.counters["oversize"] += 1
            return None
        message = _cobs_decoded(encoded)
        if message is None or len(message) < 3:
            self.counters["cobs"] += 1
            return None
        if crc_hqx(message[:-2], _CRC_START) != int.from_bytes(message[-2:], "little"):
            self.counters["crc"] += 1
            return None
        return message[:-2]


def _cobs_decoded(encoded: bytes) -> bytes | None:
    """Decode a COBS frame; None if it is invalid."""
    decoded = bytearray(encoded)  # each block's length stands where the zero before the block was
    full: list[int] = []  # where no zero was: after a full block
    at, end = 0, 0
    while end < len(encoded):
        at, length = end, encoded[end]
        end = at + length
        if end > len(encoded):
            return None
        decoded[at] = 0
        if length > _BLOCK_MAX and end < len(encoded):
            full.append(end)
    for end in reversed(full):
        del decoded[end]
    return bytes(decoded[1:])
