"""Log lines that never make the touch path wait for who reads them.

A terminal stopped with Ctrl-S, a pager, a full pipe: a write to any of them blocks for as long as nobody reads, and the
plate with it. Here such a line is dropped, and the next one that passes says how many were.
"""

from __future__ import annotations

import logging
import os
import socket
import stat
from collections.abc import Callable

Write = Callable[[bytes], int]


class JournalHandler(logging.Handler):
    """Writes each record to the file descriptor `fd`, standard error if left out, or drops it."""

    def __init__(self, fd: int = 2) -> None:
        super().__init__()
        self.dropped = 0
        self._write, self._release = _never_waiting(fd)

    def emit(self, record: logging.LogRecord) -> None:
        lost = f" ({self.dropped} lines before this one were lost: nobody read them)" if self.dropped else ""
        try:
            self._write(f"{self.format(record)}{lost}\n".encode(errors="backslashreplace"))
            self.dropped = 0
        except OSError:  # it would block, or the reader is gone: nobody is left to be told
            self.dropped += 1

    def close(self) -> None:
        self._release()
        super().close()


def _never_waiting(fd: int) -> tuple[Write, Callable[[], None]]:
    """How to write to `fd` without waiting, and what ends that. The flags of `fd` belong to others too: they stay."""
    mode = os.fstat(fd).st_mode
    if stat.S_ISSOCK(mode):  # what systemd gives a service
        stream = socket.socket(fileno=os.dup(fd))
        return lambda data: stream.send(data, socket.MSG_DONTWAIT), stream.close
    if stat.S_ISFIFO(mode) or os.isatty(fd):
        try:
            own = os.open(f"/proc/self/fd/{fd}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        except OSError:
            pass  # another's terminal, or no /proc: as it is
        else:
            return lambda data: os.write(own, data), lambda: os.close(own)
    return lambda data: os.write(fd, data), lambda: None
