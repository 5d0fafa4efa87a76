"""systemd notification and journal format, against a socket in place of the manager."""

from __future__ import annotations

import logging
import os
import socket

import pytest

from hapticd.io.host.systemd import JournalFormatter, Notifier

MS = 1_000_000


def received(manager: socket.socket) -> list[bytes]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(4096))
        except BlockingIOError:
            return messages


def environ(manager: socket.socket, **more: str) -> dict[str, str]:
    return {"NOTIFY_SOCKET": manager.getsockname(), **more}


def test_the_watchdog_is_fed_three_times_within_its_time_and_no_oftener(manager: socket.socket) -> None:
    notifier = Notifier(environ(manager, WATCHDOG_USEC="900000", WATCHDOG_PID=str(os.getpid())))
    for t_ms in range(0, 1801, 20):  # from the origin of time on
        notifier.feed_watchdog(t_ms * MS)
    assert received(manager) == [b"WATCHDOG=1"] * 7
    notifier.close()


@pytest.mark.parametrize("more", [{}, {"WATCHDOG_USEC": "junk"}, {"WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"}])
def test_a_watchdog_that_is_not_ours_is_not_fed(manager: socket.socket, more: dict[str, str]) -> None:
    notifier = Notifier(environ(manager, **more))
    notifier.feed_watchdog(5_000 * MS)
    assert received(manager) == []
    notifier.close()


@pytest.mark.parametrize(("level", "priority"), [("DEBUG", 7), ("INFO", 6), ("WARNING", 4), ("ERROR", 3)])
def test_each_line_for_the_journal_has_its_priority(level: str, priority: int) -> None:
    number = logging.getLevelNamesMapping()[level]
    record = logging.LogRecord("hapticd", number, "", 0, "one\n%s", ("two",), None)
    assert JournalFormatter().format(record) == f"<{priority}>one\n<{priority}>two"
