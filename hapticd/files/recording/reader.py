"""Reads recordings: whatever the bytes, records or RecordingError, in memory and time that the file's size bounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import RecordingError
from .framing import HEADER_KIND, MAGIC, RawRecord, Scanner
from .header import Header, decode_header
from .records import Record, record_of

READ_BYTES = 1 << 18


@dataclass(slots=True)
class Losses:
    """What a recording lacks. `gaps` are places in the numbering, `missing` the records that stood there."""

    skipped_bytes: int = 0
    gaps: int = 0
    missing: int = 0
    unreadable: int = 0
    first_seq: int | None = None  # the first that is missing

    @property
    def any(self) -> bool:
        """Something is lost within: an end that was cut off is none, for nobody knows what would have come."""
        return self.gaps > 0 or self.unreadable > 0

    def told(self) -> str:
        """For a person; empty where nothing is lost."""
        parts = []
        if self.missing:
            parts.append(f"{self.missing} records are missing in {self.gaps} places")
        if self.unreadable:
            parts.append(f"{self.unreadable} records are of no known form")
        if self.skipped_bytes:
            parts.append(f"{self.skipped_bytes} bytes belong to no whole record")
        return ", ".join(parts)


@dataclass(slots=True)
class Recording:
    """One recording in the files `paths`. `header` is at hand; `records` reads the rest, as often as it is asked to.

    `losses` and `has_end`, whether its last record is there, are known when a reading has come to its end.
    """

    paths: tuple[Path, ...]
    header: Header
    first_seq: int
    losses: Losses = field(default_factory=Losses)
    has_end: bool = False

    @property
    def is_whole(self) -> bool:
        """It begins where its machine began."""
        return self.header.is_whole and self.first_seq == 0

    def records(self) -> Iterator[Record]:
        """All intact records in their order. Raises RecordingError where a file cannot be read to its end."""
        self.losses = losses = Losses()
        self.has_end = False
        expected = self.first_seq
        for raw in _raw_of_all(self.paths, losses):
            if raw.kind == HEADER_KIND:
                if raw.seq < expected and raw.seq != 0:
                    raise RecordingError(f"{self.paths[-1]}: comes before the other: give the files in their order.")
                _note_gap(losses, expected, raw.seq)
                expected = max(expected, raw.seq)
                continue
            _note_gap(losses, expected, raw.seq)
            expected = raw.seq + 1
            try:
                record = record_of(raw.kind, raw.seq, raw.body)
            except RecordingError:
                losses.unreadable += 1
                continue
            if record is not None:
                self.has_end = record.kind == "end"
                yield record


def open_recording(paths: Path | Sequence[Path]) -> Recording:
    """The recording in these files, which are parts of one and follow each other. Raises RecordingError."""
    files = (paths,) if isinstance(paths, Path) else tuple(paths)
    headers = [_header(path) for path in files]
    first, header = headers[0]
    for path, (_, other) in zip(files, headers, strict=True):
        if (other.instance, other.t_start_ns) != (header.instance, header.t_start_ns):
            raise RecordingError(f"{path}: is no part of the recording in {files[0]}: replay it by itself.")
    return Recording(files, header, first.seq)


def _note_gap(losses: Losses, expected: int, seq: int) -> None:
    if seq <= expected:
        return
    losses.gaps += 1
    losses.missing += seq - expected
    if losses.first_seq is None:
        losses.first_seq = expected


def _header(path: Path) -> tuple[RawRecord, Header]:
    for raw in _raw(path, Losses()):
        if raw.kind == HEADER_KIND:
            try:
                return raw, decode_header(raw.body)
            except RecordingError as error:
                raise RecordingError(f"{path}: {error}") from None
    raise RecordingError(f"{path}: the recording's header is missing or damaged: without it nothing can be read.")


def _raw_of_all(paths: Sequence[Path], losses: Losses) -> Iterator[RawRecord]:
    for path in paths:
        yield from _raw(path, losses)


def _raw(path: Path, losses: Losses) -> Iterator[RawRecord]:
    scanner = Scanner()
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{path}: is no recording of hapticd's: it does not begin as one.")
            while data := file.read(READ_BYTES):
                yield from scanner.feed(data)
            yield from scanner.finish()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}): check the path.") from None
    except RecordingError as error:
        raise error if str(path) in str(error) else RecordingError(f"{path}: {error}") from None
    finally:
        losses.skipped_bytes += scanner.skipped_bytes
