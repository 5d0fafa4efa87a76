"""Non-blocking log output: a slow reader never delays the touch path.

A write to a terminal stopped with Ctrl-S, a pager or a full pipe blocks until it is read. Such a line is dropped here,
and the next written line reports how many were.
"""

from __future__ import annotations

import logging
import os
import socket
import stat
from collections.abc import Callable

Write = Callable[[bytes], int]


class JournalHandler(logging.Handler):
    """Write each record to the file descriptor `fd` (default: standard error), or drop it."""

    def __init__(self, fd: int = 2) -> None:
        super().__init__()
        self.dropped = 0
        self._write, self._release = _non_blocking(fd)

    def emit(self, record: logging.LogRecord) -> None:
        lost = f" ({self.dropped} earlier lines were dropped: the output was not read)" if self.dropped else ""
        try:
            self._write(f"{self.format(record)}{lost}\n".encode(errors="backslashreplace"))
            self.dropped = 0
        except OSError:  # it would block, or the reader is gone
            self.dropped += 1

    def close(self) -> None:
        self._release()
        super().close()


def _non_blocking(fd: int) -> tuple[Write, Callable[[], None]]:
    """Return functions that write to `fd` without blocking and that close it. Shared flags of `fd` stay unchanged."""
    mode = os.fstat(fd).st_mode
    if stat.S_ISSOCK(mode):  # what systemd gives a service
        stream = socket.socket(fileno=os.dup(fd))
        return lambda data: stream.send(data, socket.MSG_DONTWAIT), stream.close
    if stat.S_ISFIFO(mode) or os.isatty(fd):
        try:
            own = os.open(f"/proc/self/fd/{fd}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        except OSError:
            pass  # another user's terminal, or no /proc: write blocking
        else:
            return lambda data: os.write(own, data), lambda: os.close(own)
    return lambda data: os.write(fd, data), lambda: None
