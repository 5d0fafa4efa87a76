"""The service's side of systemd: readiness and the watchdog by sd_notify(3), lines with a priority for the journal."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Mapping

__all__ = ["JournalFormatter", "Notifier", "is_journal_stream"]


class Notifier:
    """Tells the service manager how it stands; says nothing where none asked (`NOTIFY_SOCKET` is not set)."""

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address  # an abstract socket
        is_for_us = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self._watchdog_ns = _microseconds(environ.get("WATCHDOG_USEC", "")) * 1000 if is_for_us and address else 0
        self._t_fed_ns: int | None = None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)

    def tell(self, **state: str | int) -> bool:
        """Send assignments such as `ready=1, status="..."`. False where nobody listens or nothing can be sent."""
        if self._socket is None:
            return False
        lines = "\n".join(f"{name.upper()}={value}" for name, value in state.items())
        try:
            self._socket.sendto(lines.encode(), self._address)
        except OSError:
            return False  # the manager's trouble must not be ours; a watchdog not fed shows it
        return True

    def feed_watchdog(self, t_now_ns: int) -> None:
        """All is well at `t_now_ns`: tell it three times within the time that the manager waits."""
        if self._watchdog_ns == 0:
            return
        if self._t_fed_ns is None or t_now_ns - self._t_fed_ns >= self._watchdog_ns // 3:
            self._t_fed_ns = t_now_ns
            self.tell(watchdog=1)

    def close(self) -> None:
        """Say no more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _microseconds(text: str) -> int:
    return int(text) if text.isdecimal() else 0


def is_journal_stream(fd: int, environ: Mapping[str, str] = os.environ) -> bool:
    """Whether the descriptor is the journal's own stream, as `JOURNAL_STREAM` (device:inode) says."""
    try:
        stream = os.fstat(fd)
    except OSError:
        return False
    return environ.get("JOURNAL_STREAM") == f"{stream.st_dev}:{stream.st_ino}"


class JournalFormatter(logging.Formatter):
    """Lines as the journal wants them: a priority in front of each, no time, for it has its own (sd-daemon(3))."""

    def __init__(self) -> None:
        super().__init__("%(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """The record, each of its lines with the priority of its level."""
        prefix = f"<{_priority(record.levelno)}>"
        return "\n".join(prefix + line for line in super().format(record).splitlines() or [""])


def _priority(level: int) -> int:
    """syslog(3)'s number of a level: 7 debug, 6 info, 4 warning, 3 error, 2 critical."""
    for least, priority in ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6)):
        if level >= least:
            return priority
    return 7
