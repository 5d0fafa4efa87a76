"""Records on disk and on the `record` socket: a head, a body, and checksums of both. README.md here has the layout.

Sans-I/O: bytes in, records out, in pieces of any size. What is damaged or cut is lost alone: a reader goes on at the
next intact record, and what a number in the sequence lacks was lost.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from ...errors import RecordingError

MAGIC = b"\x89hapticd\r\n\x1a\n\0\0\0\1"  # as PNG's: a transfer that changes line ends is seen at once
SYNC = b"\xa5rec"
HEAD = struct.Struct("<4sBxHIII")  # sync, kind, check of the head, seq, length and CRC-32 of the body
MAX_BODY_BYTES = 1 << 20
MAX_HEADER_BYTES = 1 << 22  # the header holds the mode map: at most 250 000 values of 8 bytes
HEADER_KIND = 0
MAX_CHECKED = 8  # times a file's bytes are checked in vain; only a file made to be slow needs more

_CHECKED = struct.Struct("<BII")


class RawRecord(NamedTuple):
    """A record as it was framed. `seq` counts the records of one recording."""

    kind: int
    seq: int
    body: bytes


def frame(kind: int, seq: int, body: bytes) -> bytes:
    """One record's bytes. Raises RecordingError for a body that no reader would take."""
    if len(body) > longest_bytes(kind):
        raise RecordingError(f"A record of {len(body)} bytes cannot be kept: at most {longest_bytes(kind)} can.")
    seq &= 0xFFFFFFFF
    return HEAD.pack(SYNC, kind, _head_check(kind, seq, len(body)), seq, len(body), zlib.crc32(body)) + body


def longest_bytes(kind: int) -> int:
    """The longest body that a record of this kind may have."""
    return MAX_HEADER_BYTES if kind == HEADER_KIND else MAX_BODY_BYTES


class Scanner:
    """Finds the intact records in a stream that begins behind MAGIC. Holds at most one record and what was fed last.

    `skipped_bytes` belonged to no intact record. Raises RecordingError where finding records costs out of all
    proportion.
    """

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self._buffer = bytearray()
        self._fed_bytes = self._checked_in_vain = 0

    def feed(self, data: bytes) -> Iterator[RawRecord]:
        """The records that these bytes complete; iterate to the end before the next call."""
        self._buffer += data
        self._fed_bytes += len(data)
        yield from self._scan(is_end=False)

    def finish(self) -> Iterator[RawRecord]:
        """The records behind a head that promised more than there is."""
        yield from self._scan(is_end=True)
        self.skipped_bytes += len(self._buffer)
        self._buffer.clear()

    def _scan(self, *, is_end: bool) -> Iterator[RawRecord]:
        buffer, at = self._buffer, 0
        try:
            while True:
                found = buffer.find(SYNC, at)
                if found < 0:
                    found = max(at, len(buffer) - len(SYNC) + 1)
                    self.skipped_bytes += found - at
                    at = found
                    return
                self.skipped_bytes += found - at
                at = found
                if len(buffer) - at < HEAD.size:
                    if not is_end:
                        return
                    record = None
                else:
                    record, is_complete = self._record_at(at)
                    if not (is_complete or is_end):
                        return
                if record is None:
                    self.skipped_bytes += 1
                    at += 1
                else:
                    at += HEAD.size + len(record.body)
                    yield record
        finally:
            del buffer[:at]

    def _record_at(self, at: int) -> tuple[RawRecord | None, bool]:
        """The intact record at a sync, and whether all its bytes are there; None where it is none (yet)."""
        _, kind, check, seq, length, crc = HEAD.unpack_from(self._buffer, at)
        if check != _head_check(kind, seq, length) or length > longest_bytes(kind):
            return None, True
        start = at + HEAD.size
        if len(self._buffer) - start < length:
            return None, False
        body = bytes(self._buffer[start : start + length])
        if zlib.crc32(body) == crc:
            return RawRecord(kind, seq, body), True
        self._checked_in_vain += length
        if self._checked_in_vain > MAX_CHECKED * self._fed_bytes + MAX_BODY_BYTES:
            raise RecordingError("The recording is damaged beyond reading: heads of records stand within records.")
        return None, True


def _head_check(kind: int, seq: int, length: int) -> int:
    return zlib.crc32(_CHECKED.pack(kind, seq, length)) & 0xFFFF
