"""Whole chunks of an MCAP file, wherever they stand: none needs the lengths of what precedes it.

A chunk is where its head is consistent and its checksum right. Copies of the header's chunk are equal to the last byte,
so where all are damaged each byte is that of the most of them.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord
from mcap.stream_reader import breakup_chunk

from .kinds import MAX_HEADER_BYTES

MAX_CHUNK_BYTES = 2 * MAX_HEADER_BYTES  # also unpacked; the longest that is written is the header's
MAX_RATIO = 200  # of a chunk's sizes unpacked and packed: an hour at rest has 20
SMALL_BYTES = 1 << 16  # of a chunk unpacked that may exceed MAX_RATIO
MAGIC = b"\x89MCAP0\r\n"
PIECE_BYTES = 1 << 16
MOST_GAP_RECORDS = 1000  # between two chunks: an index for each kind
KEPT_BYTES = 4 * MAX_CHUNK_BYTES  # of damaged chunks, for a vote
PLACE_BYTES = 1024  # what it counts to look whether a chunk begins at a place
WORK_FACTOR = 8  # bytes of damaged chunks that are unpacked, for each of the file
_HEAD = struct.Struct("<BQQQQII")  # opcode, length, first and last time, unpacked size, CRC, length of the compression
_CHUNK, _DATA_END = 0x06, 0x0F
_BEGIN = re.compile(rb"\x06(?=[\s\S]{3}\0{5})")  # opcode, and a length below 16 MiB
_DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, MemoryError)


class _Found(NamedTuple):
    """A chunk whose head is consistent, at `at` in the file."""

    at: int
    end: int
    chunk: Chunk


class Chunks:
    """The whole chunks of a file, each as its records; to be iterated as often as needed."""

    def __init__(self, file: BinaryIO) -> None:
        self._fd = file.fileno()
        self._size = os.fstat(self._fd).st_size
        self.is_begun = self._read(0, len(MAGIC)) == MAGIC
        self._restart()

    def _restart(self) -> None:
        self.skipped_bytes = 0
        self.share = 0.0
        self.is_compressed_otherwise = False
        self._kept_left = KEPT_BYTES
        self._work_left = WORK_FACTOR * self._size + MAX_CHUNK_BYTES

    def __iter__(self) -> Iterator[list[McapRecord]]:
        self._restart()
        at = len(MAGIC) if self.is_begun else 0
        damaged: dict[int, list[bytes]] = {}
        is_header_whole = False
        while True:
            found, records = self._next_whole(at, damaged)
            end = self._size if found is None else found.at
            self.skipped_bytes += self._unclaimed(at, end)
            if found is None:
                break
            is_header_whole = is_header_whole or any(isinstance(record, Channel) for record in records)
            self.share = found.end / self._size
            yield records
            at = found.end
        if not is_header_whole:
            yield from _voted(damaged)

    def _read(self, at: int, size: int) -> bytes:
        return os.pread(self._fd, size, at)

    def _next_whole(self, at: int, damaged: dict[int, list[bytes]]) -> tuple[_Found | None, list[McapRecord]]:
        """Return the first whole chunk from `at` on; keep damaged ones for a vote."""
        for place in self._places(at):
            self._work_left -= PLACE_BYTES
            if self._work_left < 0:
                break
            found = self._consistent(place)
            if found is None:
                continue
            records = unpacked(found.chunk)
            if records is not None:
                return found, records
            size = found.end - found.at
            self._work_left -= size + found.chunk.uncompressed_size
            if size <= self._kept_left:
                self._kept_left -= size
                damaged.setdefault(size, []).append(self._read(found.at, size))
        return None, []

    def _places(self, at: int) -> Iterator[int]:
        """Where a chunk may begin, from `at` on."""
        while at + _HEAD.size <= self._size:
            piece = self._read(at, PIECE_BYTES)
            for match in _BEGIN.finditer(piece):
                yield at + match.start()
            at += max(len(piece) - 8, 1)

    def _consistent(self, at: int) -> _Found | None:
        head = self._read(at, _HEAD.size)
        if len(head) < _HEAD.size:
            return None
        _, length, start, end, size, crc, name_bytes = _HEAD.unpack(head)
        if name_bytes > 4 or not 40 + name_bytes <= length <= min(MAX_CHUNK_BYTES, self._size - at - 9):
            return None
        rest = self._read(at + _HEAD.size, name_bytes + 8)
        packed = int.from_bytes(rest[name_bytes:], "little")
        if packed != length - 40 - name_bytes or size > MAX_CHUNK_BYTES:
            return None
        name = rest[:name_bytes].decode(errors="replace")
        if name not in ("", "zstd"):
            self.is_compressed_otherwise = self.is_compressed_otherwise or name == "lz4"
            return None
        if name == "zstd" and size > max(MAX_RATIO * packed, SMALL_BYTES):
            return None
        if name == "" and size != packed:
            return None
        data = self._read(at + _HEAD.size + name_bytes + 8, packed)
        return _Found(at, at + 9 + length, Chunk(name, data, end, start, crc, size))

    def _unclaimed(self, at: int, end: int) -> int:
        """Return how many bytes from `at` to `end` are no whole records."""
        for _ in range(MOST_GAP_RECORDS):
            if at >= end:
                return 0
            head = self._read(at, 9)
            if len(head) < 9 or head[0] in (0, _CHUNK):
                break
            if head[0] == _DATA_END:
                return 0
            after = at + 9 + int.from_bytes(head[1:], "little")
            if after > end:
                break
            at = after
        return end - at


def unpacked(chunk: Chunk) -> list[McapRecord] | None:
    """Return the records of a chunk; None where it is damaged."""
    try:
        data = chunk.data
        if chunk.compression:
            stream = zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES).stream_reader(data)
            data = stream.read(chunk.uncompressed_size + 1)
        if len(data) != chunk.uncompressed_size:
            return None
        plain = Chunk("", data, chunk.message_end_time, chunk.message_start_time, chunk.uncompressed_crc, len(data))
        return breakup_chunk(plain, validate_crc=True)
    except _DAMAGE:
        return None


def _voted(damaged: dict[int, list[bytes]]) -> Iterator[list[McapRecord]]:
    """Yield what three or more damaged chunks of one length were, if they are copies of one."""
    for alike in damaged.values():
        if len(alike) < 3:
            continue
        copies = np.sort(np.array([np.frombuffer(copy, np.uint8) for copy in alike]), axis=0)
        data = copies[len(alike) // 2].tobytes()  # what most have is in the middle
        _, _, start, end, size, crc, name_bytes = _HEAD.unpack_from(data)
        name = data[_HEAD.size : _HEAD.size + name_bytes].decode(errors="replace")
        records = unpacked(Chunk(name, data[_HEAD.size + name_bytes + 8 :], end, start, crc, size))
        if records is not None:
            yield records
