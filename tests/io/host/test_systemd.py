"""systemd notification and journal format, against a socket in place of the manager."""

from __future__ import annotations

import logging
import os
import socket
import sys
from pathlib import Path

import pytest

from hapticd.io.host.systemd import JournalFormatter, Notifier, is_journal_stream

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


def test_without_a_manager_nothing_is_sent() -> None:
    notifier = Notifier({"WATCHDOG_USEC": "1000"})
    assert not notifier.notify(ready=1)
    notifier.feed_watchdog(0)
    notifier.close()


def test_assignments_go_out_as_lines_of_one_message(manager: socket.socket) -> None:
    notifier = Notifier(environ(manager))
    assert notifier.notify(ready=1, status="serving")
    assert received(manager) == [b"READY=1\nSTATUS=serving"]
    notifier.close()
    assert not notifier.notify(stopping=1)


@pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's")
def test_an_abstract_socket_is_found() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0hapticd-test-{os.getpid()}")
        notifier = Notifier({"NOTIFY_SOCKET": f"@hapticd-test-{os.getpid()}"})
        assert notifier.notify(ready=1)
        assert listening.recv(100) == b"READY=1"
        notifier.close()


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


def test_a_manager_that_is_gone_or_does_not_read_is_no_trouble_of_ours(manager: socket.socket) -> None:
    notifier = Notifier(environ(manager))
    while notifier.notify(watchdog=1):  # until its queue is full
        pass
    manager.close()
    assert not notifier.notify(stopping=1)
    notifier.close()


def test_the_journal_is_known_by_its_stream(tmp_path: Path) -> None:
    with (tmp_path / "log").open("w") as file:
        stream = os.fstat(file.fileno())
        assert is_journal_stream(file.fileno(), {"JOURNAL_STREAM": f"{stream.st_dev}:{stream.st_ino}"})
        assert not is_journal_stream(file.fileno(), {"JOURNAL_STREAM": "1:2"})
        assert not is_journal_stream(file.fileno(), {})
    assert not is_journal_stream(-1, {})


@pytest.mark.parametrize(("level", "priority"), [("DEBUG", 7), ("INFO", 6), ("WARNING", 4), ("ERROR", 3)])
def test_each_line_for_the_journal_has_its_priority(level: str, priority: int) -> None:
    number = logging.getLevelNamesMapping()[level]
    record = logging.LogRecord("hapticd", number, "", 0, "one\n%s", ("two",), None)
    assert JournalFormatter().format(record) == f"<{priority}>one\n<{priority}>two"
