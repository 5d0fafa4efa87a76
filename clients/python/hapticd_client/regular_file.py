"""Files from outside, all read here: regular files only, and up to a bound. A pipe would block, a device never end."""

from __future__ import annotations

import errno
import os
import stat
from typing import BinaryIO, Final

# Windows knows neither of the first two, and text files in place of the third.
_FLAGS: Final = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NONBLOCK", "O_BINARY"))


def open_regular(path: str | os.PathLike[str], max_bytes: int) -> BinaryIO:
    """Open a file for reading. Raises OSError, also for what is not a regular file of at most `max_bytes`."""
    fd = os.open(path, os.O_RDONLY | _FLAGS)
    found = os.fstat(fd)
    if stat.S_ISREG(found.st_mode) and found.st_size <= max_bytes:
        return os.fdopen(fd, "rb")
    os.close(fd)
    if stat.S_ISREG(found.st_mode):
        raise OSError(errno.EFBIG, f"More than {max_bytes} bytes", os.fspath(path))
    raise OSError(errno.EINVAL, "Not a regular file", os.fspath(path))


def read_bounded(path: str | os.PathLike[str], max_bytes: int) -> bytes:
    """Return a file's bytes. Raises OSError, also for more than `max_bytes`."""
    with open_regular(path, max_bytes) as file:
        return file.read(max_bytes)
