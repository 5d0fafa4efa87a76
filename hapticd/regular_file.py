"""Files from outside, all read here: regular files only, and up to a bound. A pipe would block, a device never end.

And files that are written: an output gets its name when it is whole.
"""

from __future__ import annotations

import csv
import errno
import io
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, BinaryIO

from .errors import HapticdError, UsageError, reason

PIECE_BYTES = 1 << 16
MAX_LINE_CHARACTERS = 1 << 14


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading. Raises OSError, also for what is not a regular file."""
    fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    mode = os.fstat(fd).st_mode
    if not stat.S_ISREG(mode):
        os.close(fd)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return os.fdopen(fd, "rb")


def read_bounded(path: Path, max_bytes: int) -> bytes:
    """Return a file's bytes. Raises OSError, also for more than `max_bytes`."""
    with open_regular(path) as file:
        return read_rest(file, path, max_bytes)


def read_rest(file: BinaryIO, path: Path, max_bytes: int) -> bytes:
    """Return what follows in an open file. Raises OSError, also for more than `max_bytes`."""
    data = bytearray()
    while piece := file.read(PIECE_BYTES):  # a read of `max_bytes` would take that much memory at once
        data += piece
        if len(data) > max_bytes:
            raise OSError(errno.EFBIG, f"More than {max_bytes} bytes", str(path))
    return bytes(data)


def read_lines(path: Path, max_lines: int) -> Iterator[tuple[int, str]]:
    """Yield number, from 1, and text of each line of a UTF-8 file, as it is read: so it takes memory for one.

    Raises OSError, also for more lines or a longer one than allowed, UnicodeDecodeError.
    """
    with open_regular(path) as file:
        yield from lines_of(file, path, max_lines)


def lines_of(file: BinaryIO, path: Path, max_lines: int) -> Iterator[tuple[int, str]]:
    """The same of an open file, which it closes."""
    with io.TextIOWrapper(file, encoding="utf-8-sig") as text:
        number = 0
        while line := text.readline(MAX_LINE_CHARACTERS + 1):
            number += 1
            if number > max_lines:
                raise OSError(errno.EFBIG, f"More than {max_lines} lines", str(path))
            if len(line) > MAX_LINE_CHARACTERS:
                raise OSError(errno.EFBIG, f"Line {number} has more than {MAX_LINE_CHARACTERS} characters", str(path))
            yield number, line.removesuffix("\n")


def csv_rows(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells, without blanks around them, of each line of a CSV file that holds data, of quoted cells
    with a line break the last one; `#` begins a comment. Raises ValueError."""
    number = 0

    def data() -> Iterator[str]:
        nonlocal number
        for number, line in lines:  # noqa: B007 - of the row that is yielded next
            if line.strip() and not line.lstrip().startswith("#"):
                yield line

    try:
        for cells in csv.reader(data(), skipinitialspace=True):
            yield number, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise ValueError(f"line {number}: is no CSV ({error}): look at its quotes.") from None


@contextmanager
def opened(path: Path, *, mode: int = 0o666) -> Iterator[IO[bytes]]:
    """Open an output. It gets its name when it is whole; until then, and after an error, an earlier file remains.

    `mode` are the permissions before the umask. Raises HapticdError, such as for a full disk.
    """
    try:
        if is_special(path):
            with path.open("wb") as file:
                yield file
            return
        with (
            named_when_whole(path) as part,
            open(os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode), "w+b") as file,
        ):
            yield file
    except OSError as error:
        raise HapticdError(f"{path}: cannot be written ({reason(error)}): choose another place.") from None


@contextmanager
def named_when_whole(path: Path) -> Iterator[Path]:
    """Yield the name of a file to write, which gets the name `path` at the end, and is deleted after an error.

    Raises UsageError for a device or a pipe, OSError.
    """
    if is_special(path):
        raise UsageError(f"{path}: is a device or a pipe: name a file.")
    whole = path.resolve()
    part = whole.with_name(f".hapticd-{os.getpid()}.part")
    try:
        yield part
        part.replace(whole)
    finally:
        part.unlink(missing_ok=True)


def is_special(path: Path) -> bool:
    """Whether it is a device or a pipe, which is written as it is."""
    return path.exists() and not path.is_file() and not path.is_dir()
