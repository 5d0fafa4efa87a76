"""Non-blocking, rate-limited log output: neither a slow reader nor a flood of lines delays the touch path.

A write to a terminal stopped with Ctrl-S, a pager or a full pipe blocks until it is read. Such a line is dropped here,
and the next written line reports how many were. So are lines that one place in the code repeats, within ten seconds: a
board, a client or a busy host that repeats a fault must neither fill the disk nor bury the cause.
"""

from __future__ import annotations

import logging
import os
import socket
import stat
from collections.abc import Callable
from dataclasses import dataclass

Write = Callable[[bytes], int]

BURST = 10  # lines of one place at once, such as what is plugged and pulled, or the refusals of one start
LINES_HZ = 0.1  # afterwards, and of the same text


@dataclass(slots=True)
class _Place:
    """Token bucket of one place in the code; `dropped` counts lines since the last one that passed."""

    tokens: float
    t_s: float
    dropped: int = 0


class LineRateLimiter(logging.Filter):
    """Pass BURST lines of each place in the code, then LINES_HZ; the next line reports how many were dropped.

    A line that repeats the last one passes once the bucket is full again.

    Lines of level DEBUG pass: only a developer requests them.
    """

    def __init__(self) -> None:
        super().__init__()
        self._places: dict[tuple[str, int], _Place] = {}
        self._last = ""  # line of any place

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the line passes; adds the number of dropped ones to its text."""
        if record.levelno < logging.INFO:
            return True
        t_s = record.created
        place = self._places.setdefault((record.pathname, record.lineno), _Place(BURST, t_s))
        place.tokens = min(place.tokens + max(t_s - place.t_s, 0.0) * LINES_HZ, BURST)
        place.t_s = t_s
        text = record.getMessage()
        if place.tokens < (BURST if text == self._last else 1.0):
            place.dropped += 1
            return False
        place.tokens -= 1.0
        self._last = text
        if place.dropped:
            record.msg = f"{text} ({place.dropped} more lines of this kind were dropped)"
            record.args = None
            place.dropped = 0
        return True


class JournalHandler(logging.Handler):
    """Write each record to the file descriptor `fd` (default: standard error), or drop it."""

    def __init__(self, fd: int = 2) -> None:
        super().__init__()
        self.addFilter(LineRateLimiter())
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
