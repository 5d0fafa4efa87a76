"""systemd integration: readiness and watchdog by sd_notify(3), log lines with a journal priority."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Mapping

__all__ = ["JournalFormatter", "Notifier", "is_journal_stream"]


class Notifier:
    """Send state to the service manager; does nothing where `NOTIFY_SOCKET` is not set."""

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address  # an abstract socket
        is_for_us = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        timeout_us = environ.get("WATCHDOG_USEC", "")
        self._watchdog_ns = int(timeout_us) * 1000 if is_for_us and address and timeout_us.isdecimal() else 0
        self._t_fed_ns: int | None = None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)

    def notify(self, **state: str | int) -> bool:
        """Send assignments such as `ready=1, status="..."`. Returns False if they could not be sent."""
        if self._socket is None:
            return False
        lines = "\n".join(f"{name.upper()}={value}" for name, value in state.items())
        try:
            self._socket.sendto(lines.encode(), self._address)
        except OSError:
            return False  # not fatal here: the manager's watchdog detects it
        return True

    def feed_watchdog(self, t_now_ns: int) -> None:
        """Send a keep-alive, three times per watchdog timeout."""
        if self._watchdog_ns == 0:
            return
        if self._t_fed_ns is None or t_now_ns - self._t_fed_ns >= self._watchdog_ns // 3:
            self._t_fed_ns = t_now_ns
            self.notify(watchdog=1)

    def close(self) -> None:
        """Close the socket; later calls do nothing."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def is_journal_stream(fd: int) -> bool:
    """Return whether the descriptor is the journal's stream, by `JOURNAL_STREAM` (device:inode)."""
    try:
        stream = os.fstat(fd)
    except OSError:
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{stream.st_dev}:{stream.st_ino}"


class JournalFormatter(logging.Formatter):
    """Format journal lines: a priority prefix on each and no time, which the journal adds (sd-daemon(3))."""

    def __init__(self) -> None:
        super().__init__("%(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Return the record with its level's priority in front of each line."""
        prefix = f"<{_priority(record.levelno)}>"
        return "\n".join(prefix + line for line in super().format(record).splitlines() or [""])


def _priority(level: int) -> int:
    """Return the syslog(3) priority: 7 debug, 6 info, 4 warning, 3 error, 2 critical."""
    for least, priority in ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6)):
        if level >= least:
            return priority
    return 7
