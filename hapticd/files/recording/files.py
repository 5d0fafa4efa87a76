"""Files of a recording: made anew, never over another one, each explaining itself, bounded in size and number."""

from __future__ import annotations

import os
from collections import deque
from pathlib import Path
from typing import Any

from ...errors import RecordingError
from .header import Header
from .stream import Stream

SUFFIX = ".hrec"


class RecordingFile:
    """One recording on disk. `write` takes framed records; a full file is followed by the next number's.

    The first file has the asked name, or where that is taken the next free one: name.hrec, name-2.hrec, name-3.hrec.
    Beyond `max_files` the oldest of this recording is removed. Raises RecordingError where a file cannot be made, and
    OSError from `write` and `sync`: after one nothing more may be written.
    """

    def __init__(self, path: Path, opening: bytes, *, max_bytes: int = 1 << 62, max_files: int = 1) -> None:
        self._asked = path
        self._number = 1
        self._max_bytes = max_bytes
        self._max_files = max_files
        self._paths: deque[Path] = deque()
        try:
            if not path.name or path.is_dir():
                raise RecordingError(f"{path}: is a folder: name a file in it, such as session{SUFFIX}.")
            self._open(opening)
        except OSError as error:
            raise RecordingError(
                f"{path}: no recording can be written there ({error.strerror}): name a file in a folder of yours."
            ) from None

    @property
    def path(self) -> Path:
        """The file that is written now."""
        return self._paths[-1]

    @property
    def written_bytes(self) -> int:
        """So many it holds."""
        return self._bytes

    def is_full_with(self, data: bytes | bytearray) -> bool:
        """These bytes would make the file too large, and it holds more than its opening."""
        return self._bytes + len(data) > self._max_bytes and self._bytes > self._opening_bytes

    def may_follow(self) -> bool:
        """Whether another file may follow a full one."""
        return self._max_files > 1

    def follow(self, opening: bytes) -> None:
        """Go on in the next file."""
        self.sync()
        os.close(self._fd)
        self._open(opening)
        if len(self._paths) > self._max_files:
            self._paths.popleft().unlink(missing_ok=True)

    def write(self, data: bytes | bytearray) -> None:
        """Append, whole: what the kernel takes in pieces is written on."""
        self._bytes += len(data)
        view = memoryview(data)
        while view:
            view = view[os.write(self._fd, view) :]

    def sync(self) -> None:
        """To the disk itself: from here on no failing power takes it away."""
        os.fsync(self._fd)

    def close(self) -> None:
        """Close the file. OSError where the disk refuses what was written."""
        os.close(self._fd)

    def _open(self, opening: bytes) -> None:
        while True:
            path = _numbered(self._asked, self._number)
            self._number += 1
            try:
                self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o640)
                break
            except FileExistsError:
                continue
        self._paths.append(path)
        self._bytes = 0
        self._opening_bytes = len(opening)
        self.write(opening)


class DirectRecording:
    """A recording written by whoever calls it, at once: for virtual time, where nobody waits."""

    def __init__(self, path: Path, header: Header) -> None:
        """Raises RecordingError."""
        self._stream = Stream(header)
        self._file = RecordingFile(path, self._stream.opening())
        self._pending = bytearray()

    @property
    def path(self) -> Path:
        """Where it is."""
        return self._file.path

    def put(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's tap. Raises RecordingError where the disk takes no more."""
        self._pending += self._stream.record(kind, t_ns, values)
        if len(self._pending) > 1 << 16:
            self._flush()

    def close(self, t_ns: int, reason: str) -> None:
        """The last record, and the end."""
        self.put("end", t_ns, reason)
        self._flush()
        self._file.close()

    def _flush(self) -> None:
        try:
            self._file.write(self._pending)
        except OSError as error:
            raise RecordingError(f"{self._file.path}: the recording ends here ({error.strerror}).") from None
        self._pending.clear()


def _numbered(path: Path, number: int) -> Path:
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
