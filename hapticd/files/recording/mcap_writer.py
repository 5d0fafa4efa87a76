"""Recordings on disk: MCAP files, never over an existing one, each readable by itself, bounded in size and number.

A file begins with the header in a chunk of its own, with schemas and channels. What was added since the last chunk
ended is lost with a process that is killed; `flush` ends the chunk, and compresses it without holding the interpreter.
"""

from __future__ import annotations

import json
import os
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from ... import __version__
from ...errors import RecordingError
from .header import Header, header_fields, texts_of
from .kinds import HEADER, KINDS, Record, encode, json_schema, record_of

SUFFIX = ".mcap"
COMPRESSION = CompressionType.ZSTD
CHUNK_BYTES = 1 << 18  # a chunk is ended by `flush`, or by this size
MESSAGE_BYTES = 31 + 16  # of a message's head and its index
CHUNK_INDEX_BYTES = 600  # at the end of the file and behind the chunk, with a place for every kind
TURN_S = 1e-4
SUMMARY_BYTES = 16_384  # schemas and channels at the end of the file


class RecordingFile:
    """One recording on disk, in one file or, where `max_files` allows, in numbered ones that follow each other.

    The first file has the given name, or where that is taken the next free one: name.mcap, name-2.mcap, name-3.mcap.
    Beyond `max_files` the oldest of this recording is removed. Raises RecordingError where a file cannot be made;
    `add`, `flush`, `sync` and `close` raise OSError, after which only `close` may be called.
    """

    def __init__(
        self, path: Path, header: Header, *, seq: int = 0, max_bytes: int = 1 << 62, max_files: int = 1
    ) -> None:
        """`seq` is the number of the first record."""
        self.left_out = 0  # records that no reader would take: a reader misses their numbers
        self._header = header
        self._requested = path
        self._number = 1
        self._max_bytes = max_bytes
        self._max_files = max_files
        self._paths: deque[Path] = deque()
        self._pending_bytes = self._records = 0
        self._index_bytes = SUMMARY_BYTES
        self._mcap: McapWriter
        self._output = _Output(-1)
        with _in_a_sentence(path):
            try:
                self._open(seq)
            except OSError:
                self._output.close()
                raise

    @property
    def path(self) -> Path:
        """The file that is written now."""
        return self._paths[-1]

    @property
    def written_bytes(self) -> int:
        """Its size, with what waits for the end of the chunk."""
        return self._output.bytes + self._pending_bytes

    def add(self, record: Record) -> None:
        """Append. Raises RecordingError where the file is full and none may follow."""
        try:
            data = encode(record.kind, record.fields)
        except RecordingError:
            self.left_out += 1
            return
        size = len(data) + MESSAGE_BYTES
        if self.written_bytes + size + self._index_bytes > self._max_bytes and self._records:
            if self._max_files == 1:
                raise RecordingError("the file has reached record.max_mb")
            self._follow(record.seq)
        self._add(record.kind, record.seq, record.t_ns, data)
        self._records += 1
        if self._pending_bytes > CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """End the chunk and hand it to the kernel."""
        if self._pending_bytes:
            self._index_bytes += CHUNK_INDEX_BYTES
            self._pending_bytes = 0
            with _short_turns():
                self._mcap.flush()  # type: ignore[no-untyped-call]

    def sync(self) -> None:
        """End the chunk and have it on the disk: a power failure does not lose it."""
        self.flush()
        os.fsync(self._output.fd)

    def close(self) -> None:
        """Write the index and close the file; after an error close it as it is. Safe to call twice."""
        try:
            if self._output.is_sound:
                self.flush()
                with _short_turns():
                    self._mcap.finish()  # type: ignore[no-untyped-call]
        finally:
            self._output.close()

    def _follow(self, seq: int) -> None:
        with _short_turns():
            self.sync()
            self.close()
            self._open(seq)
        if len(self._paths) > self._max_files:
            self._paths.popleft().unlink(missing_ok=True)

    def _open(self, seq: int) -> None:
        header = encode(HEADER, header_fields(self._header))
        self._output = _Output(self._created())
        self._pending_bytes = self._records = 0
        self._index_bytes = SUMMARY_BYTES
        self._mcap = McapWriter(cast("IO[Any]", self._output), chunk_size=1 << 62, compression=COMPRESSION)
        self._mcap.start(profile="hapticd", library=f"hapticd {__version__}")
        self._channels = {name: self._register(name) for name in KINDS}
        self._add(HEADER, seq, self._header.t_start_ns, header)
        self.flush()
        self._mcap.add_metadata("hapticd", texts_of(self._header))

    def _created(self) -> int:
        fd, path, number = _create(self._requested, self._number)
        self._number = number + 1
        self._paths.append(path)
        return fd

    def _register(self, name: str) -> int:
        kind, schema_id = KINDS[name], 0
        if kind.encoding == "json":
            schema = json_schema(kind.form)
            schema_id = self._mcap.register_schema(f"hapticd.{name}", "jsonschema", json.dumps(schema).encode())
        return self._mcap.register_channel(kind.topic, kind.encoding, schema_id)

    def _add(self, kind: str, seq: int, t_ns: int, data: bytes) -> None:
        self._mcap.add_message(self._channels[kind], t_ns, data, t_ns, seq & 0xFFFFFFFF)
        self._pending_bytes += len(data) + MESSAGE_BYTES


def check_destination(path: Path) -> None:
    """Raise RecordingError where no recording of this name can be made: create its file, and remove it."""
    with _in_a_sentence(path):
        fd, created, _ = _create(path, 1)
        os.close(fd)
        created.unlink()


@contextmanager
def _in_a_sentence(path: Path) -> Iterator[None]:
    """Raise RecordingError for a folder, and for a file that cannot be created."""
    if not path.name or path.is_dir():
        raise RecordingError(f"{path}: is a folder: name a file in it, such as session{SUFFIX}.")
    try:
        yield
    except OSError as error:
        raise RecordingError(
            f"{path}: no recording can be written there ({error.strerror}): name a file in a folder of yours."
        ) from None


def _create(requested: Path, number: int) -> tuple[int, Path, int]:
    """Create the first free file of this name from `number` on; return it open, its path and its number."""
    while True:
        path = requested if number == 1 else requested.with_name(f"{requested.stem}-{number}{requested.suffix}")
        try:
            return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o640), path, number
        except FileExistsError:
            number += 1


class DirectRecording:
    """A recording written by its caller at once: for virtual time, where nothing waits."""

    def __init__(self, path: Path, header: Header) -> None:
        """Raises RecordingError."""
        self._file = RecordingFile(path, header)
        self.path = self._file.path
        self._seq = 0

    def put(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's observer. Raises RecordingError where the disk takes no more."""
        try:
            self._file.add(record_of(kind, self._seq, t_ns, values))
        except OSError as error:
            raise RecordingError(f"{self.path}: the recording ends here ({error.strerror}).") from None
        self._seq += 1

    def close(self, t_ns: int, reason: str) -> None:
        """Add the last record and close the file."""
        self.put("end", t_ns, reason)
        try:
            self._file.close()
        except OSError as error:
            raise RecordingError(f"{self.path}: the recording ends here ({error.strerror}).") from None


@contextmanager
def _short_turns() -> Iterator[None]:
    """Give up the interpreter every 0.1 ms: to index a second of records takes 0.7 ms, and to end a file 0.1 s."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(TURN_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


class _Output:
    """A file as MCAP's writer needs it, without a buffer of its own: an error shows where it happens, and once."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self.bytes = 0
        self.is_sound = fd >= 0

    def write(self, data: bytes) -> int:
        """Append, whole: the kernel may take it in pieces."""
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self.fd, view) :]
        except OSError:
            self.is_sound = False
            raise
        self.bytes += len(data)
        return len(data)

    def tell(self) -> int:
        """The size so far."""
        return self.bytes

    def flush(self) -> None:
        """Nothing is buffered."""

    def close(self) -> None:
        """Close the file, once: its number may be another file's later."""
        fd, self.fd, self.is_sound = self.fd, -1, False
        if fd >= 0:
            os.close(fd)
