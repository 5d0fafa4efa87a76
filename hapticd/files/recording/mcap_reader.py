"""Reads recordings: whatever the bytes, records or RecordingError, in memory and time that the file's size bounds.

Each whole chunk is found by itself, without index or lengths of others (`mcap_chunks`): what a killed writer left is
read up to its last whole chunk, and a damaged one is lost alone. The header is that of any of its copies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Message

from ...errors import RecordingError
from ...regular_file import open_regular
from .header import Header, header_from
from .kinds import HEADER, KINDS, MAX_WHOLE, Record, decode
from .mcap_chunks import Chunks


@dataclass(slots=True)
class Losses:
    """What a recording lacks. `gaps` are places in the numbering, `missing` the records that were there."""

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


def _header(path: Path) -> tuple[int, Header]:
    for kind, message in _messages(path, Losses()):
        if kind == HEADER:
            try:
                return message.sequence, header_from(decode(HEADER, message.data))
            except RecordingError as error:
                raise RecordingError(f"{path}: {error}") from None
    raise RecordingError(f"{path}: the recording's header is missing or damaged: without it nothing can be read.")


def _record(kind: str, message: Message) -> Record:
    if message.log_time > MAX_WHOLE:
        raise RecordingError("An instant is beyond all clocks.")
    return Record(kind, message.sequence, message.log_time, decode(kind, message.data))


def _messages(
    path: Path, losses: Losses, progress: Callable[[float], None] = lambda _: None
) -> Iterator[tuple[str | None, Message]]:
    """All messages of intact chunks, each with its kind; None where its topic is unknown."""
    try:
        with open_regular(path) as file:
            yield from _intact(path, file, losses, progress)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}): check the path.") from None


def _intact(
    path: Path, file: BinaryIO, losses: Losses, progress: Callable[[float], None]
) -> Iterator[tuple[str | None, Message]]:
    names = {(kind.topic, kind.encoding): name for name, kind in KINDS.items()}
    found = Chunks(file)
    channels: dict[int, str | None] = {}
    if not found.is_begun and next(iter(found), None) is None:
        raise RecordingError(f"{path}: is no recording of hapticd's: it does not begin as one.")
    waiting: list[Message] = []  # of channels that a later copy of the header names
    for parts in found:
        progress(found.share)
        channels |= {
            part.id: names.get((part.topic, part.message_encoding)) for part in parts if isinstance(part, Channel)
        }
        waiting += [part for part in parts if isinstance(part, Message)]
        if channels:
            for message in waiting:
                yield channels.get(message.channel_id), message
            waiting.clear()
    losses.skipped_bytes += found.skipped_bytes
    if found.is_compressed_otherwise:
        raise RecordingError(f"{path}: its chunks are compressed: decompress it first (`mcap decompress`).")
