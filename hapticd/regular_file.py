"""Files from outside, read as regular files only and up to a bound: a pipe would block, a device never end."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

PIECE_BYTES = 1 << 16


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
    data = bytearray()
    with open_regular(path) as file:
        while piece := file.read(PIECE_BYTES):  # a read of `max_bytes` would take that much memory at once
            data += piece
            if len(data) > max_bytes:
                raise OSError(errno.EFBIG, f"More than {max_bytes} bytes", str(path))
    return bytes(data)
