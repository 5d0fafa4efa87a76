"""Reads recordings: whatever the bytes, records or RecordingError, in memory and time that the file's size bounds.

Without the index at the end: what a killed writer left is read up to its last whole chunk, and a chunk with a wrong
checksum is lost alone. Earlier recordings have copies of their header, any of which will do.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import breakup_chunk

from ...errors import RecordingError
from ...regular_file import open_regular
from ...values import AffineMap, TouchFrame
from ...wire.trackpad import Decoder
from .header import Header, header_from
from .kinds import HEADER, KINDS, MAX_HEADER_BYTES, MAX_WHOLE, Record, decode, pad_of

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES = 2 * MAX_HEADER_BYTES  # also unpacked; the longest that is written is the header's
MAX_RATIO = 200  # of a chunk's sizes unpacked and packed: an hour at rest has 20
SMALL_BYTES = 1 << 16  # of a chunk unpacked that may exceed MAX_RATIO
_HEAD_BYTES = 9  # opcode and length of a record
_DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, MemoryError, RuntimeError)


@dataclass(slots=True)
class Losses:
    """Losses of a recording. `gaps` are places in the numbering, `missing` the records that were there."""

    skipped_bytes: int = 0
    gaps: int = 0
    missing: int = 0
    unreadable: int = 0
    first_seq: int | None = None  # the first that is missing

    @property
    def any(self) -> bool:
        """Something is lost within; a cut end is no loss, since its length is unknown."""
        return self.gaps > 0 or self.unreadable > 0

    def report(self) -> str:
        """For a person; empty where nothing is lost."""
        parts = []
        if self.missing:
            parts.append(f"{self.missing} records are missing in {self.gaps} places")
        if self.unreadable:
            parts.append(f"{self.unreadable} records are of no known form")
        if self.skipped_bytes:
            parts.append(f"{self.skipped_bytes} bytes belong to no whole chunk")
        return ", ".join(parts)

    def note_gap(self, expected: int, seq: int) -> None:
        """Records from `expected` to before `seq` are missing."""
        if seq <= expected:
            return
        self.gaps += 1
        self.missing += seq - expected
        if self.first_seq is None:
            self.first_seq = expected


@dataclass(slots=True)
class Recording:
    """One recording in the files `paths`. `header` is read at once; `records` reads the rest, as often as it is called.

    `losses` and `has_end`, whether its last record is there, are known after a reading has come to its end.
    """

    paths: tuple[Path, ...]
    header: Header
    first_seq: int
    losses: Losses = field(default_factory=Losses)
    has_end: bool = False
    progress: Callable[[float], None] = lambda _: None  # called with the share of the files that is read

    @property
    def is_whole(self) -> bool:
        """It begins where its machine began."""
        return self.header.is_whole and self.first_seq == 0

    def records(self) -> Iterator[Record]:
        """All intact records in their order. Raises RecordingError where a file cannot be read to its end."""
        self.losses = losses = Losses()
        self.has_end = False
        expected = self.first_seq
        for place, path in enumerate(self.paths):

            def has_read(share: float, done: int = place) -> None:
                self.progress((done + share) / len(self.paths))

            is_first = True
            for kind, message in _messages(path, losses, has_read):
                seq = message.sequence
                if kind == HEADER:
                    if not is_first:
                        continue
                    is_first = False
                    if seq < expected and seq != 0:
                        raise RecordingError(f"{path}: comes before the other: give the files in their order.")
                    losses.note_gap(expected, seq)
                    expected = max(expected, seq)
                    continue
                is_first = False
                losses.note_gap(expected, seq)
                expected = seq + 1
                if kind is None:  # a newer hapticd's
                    continue
                try:
                    record = _record(kind, message)
                except RecordingError:
                    losses.unreadable += 1
                    continue
                self.has_end = kind == "end"
                yield record


def open_recording(paths: Path | Sequence[Path]) -> Recording:
    """The recording in these files, which are parts of one and follow each other. Raises RecordingError."""
    files = (paths,) if isinstance(paths, Path) else tuple(paths)
    headers = [_header(path) for path in files]
    first_seq, header = headers[0]
    for path, (_, other) in zip(files, headers, strict=True):
        if (other.instance, other.t_start_ns) != (header.instance, header.t_start_ns):
            raise RecordingError(f"{path}: is no part of the recording in {files[0]}: replay it by itself.")
    return Recording(files, header, first_seq)


def touch_frames(recording: Recording, plate_from_pad: AffineMap) -> Iterator[TouchFrame | None]:
    """Yield what the pad reported; None where it was connected or disconnected, which lifts all fingers."""
    decoder = Decoder(recording.header.pad, plate_from_pad)
    for record in recording.records():
        if record.kind == "trackpad_link":
            decoder = Decoder(pad_of(record.fields) or decoder.pad, plate_from_pad)
            yield None
        elif record.kind == "reports":
            for report in record.fields["reports"]:
                yield from decoder.decode(report["data"], report["t_host_ns"])


def _header(path: Path) -> tuple[int, Header]:
    for kind, message in _messages(path, Losses()):
        if kind != HEADER:
            break
        try:
            return message.sequence, header_from(decode(HEADER, message.data))
        except RecordingError as error:
            raise RecordingError(f"{path}: {error}") from None
    with open_regular(path) as file:
        is_ours = b"hapticd" in file.read(64)  # the profile and the library of MCAP's own header
    if is_ours:
        raise RecordingError(f"{path}: the recording's header is missing or damaged: without it nothing can be read.")
    raise RecordingError(f"{path}: is no recording of hapticd's: its beginning names another program.")


def _record(kind: str, message: Message) -> Record:
    if message.log_time > MAX_WHOLE:
        raise RecordingError("An instant is beyond all clocks.")
    return Record(kind, message.sequence, message.log_time, decode(kind, message.data))


def _messages(
    path: Path, losses: Losses, progress: Callable[[float], None] = lambda _: None
) -> Iterator[tuple[str | None, Message]]:
    """All messages of whole chunks, each with its kind; None where its topic is unknown."""
    names = {(kind.topic, kind.encoding): name for name, kind in KINDS.items()}
    channels: dict[int, str | None] = {}
    try:
        with open_regular(path) as file:
            for part in _parts(path, file, losses, progress):
                if isinstance(part, Channel):
                    channels[part.id] = names.get((part.topic, part.message_encoding))
                elif isinstance(part, Message) and part.channel_id in channels:
                    yield channels[part.channel_id], part
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}): check the path.") from None


def _parts(path: Path, file: BinaryIO, losses: Losses, progress: Callable[[float], None]) -> Iterator[McapRecord]:
    """The records of whole chunks, up to where the file was cut.

    Not by the library's `StreamReader`: it parses the index of each chunk, and takes 12 s for 9 MB of zeros.
    """
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingError(f"{path}: is no recording of hapticd's: it does not begin as one.")
    size, end = os.fstat(file.fileno()).st_size, file.tell()
    while len(head := file.read(_HEAD_BYTES)) == _HEAD_BYTES and head[0] != 0:
        if head[0] == Opcode.DATA_END:
            return
        begin, end_of_record = end, end + _HEAD_BYTES + int.from_bytes(head[1:], "little")
        if end_of_record > size:
            break
        end = end_of_record
        if head[0] == Opcode.CHUNK:
            parts = _unpacked(file.read(min(end - file.tell(), MAX_CHUNK_BYTES)))
            losses.skipped_bytes += 0 if parts else end - begin
            yield from parts
            progress(end / size)
        file.seek(end)
    losses.skipped_bytes += size - end


def _unpacked(data: bytes) -> list[McapRecord]:
    """Return the records of a chunk, none where it is damaged."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(data)))
        size, is_zstd = chunk.uncompressed_size, chunk.compression == "zstd"
        longest = min(MAX_CHUNK_BYTES, max(MAX_RATIO * len(data), SMALL_BYTES))
        if max(size, zstandard.frame_content_size(chunk.data) if is_zstd else 0) > longest:
            return []
        if chunk.compression == "lz4":
            chunk.data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
            chunk.compression = ""
        return breakup_chunk(chunk, validate_crc=True)
    except _DAMAGE:
        return []
