"""Log lines never block, for any kind of standard error."""

from __future__ import annotations

import contextlib
import logging
import os
import pty
import re
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticd.io.host.journal import BURST, JournalHandler


def pipe() -> tuple[int, int]:
    return os.pipe()


def terminal() -> tuple[int, int]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    return master, slave


def stream() -> tuple[int, int]:
    reader, writer = socket.socketpair()
    return reader.detach(), writer.detach()


@pytest.fixture(params=[pipe, terminal, stream])
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[int, int]]:
    reader, writer = request.param()
    yield reader, writer
    os.close(reader)
    os.close(writer)


def record(text: str, t_s: float = 0.0) -> logging.LogRecord:
    made = logging.LogRecord("hapticd", logging.INFO, __file__, 1, text, None, None)
    made.created = t_s
    return made


def drain(reader: int) -> bytes:
    os.set_blocking(reader, False)
    read = b""
    with contextlib.suppress(BlockingIOError):
        while piece := os.read(reader, 65536):
            read += piece
    return read


def test_a_stalled_reader_loses_lines_and_gets_their_number(ends: tuple[int, int]) -> None:
    reader, writer = ends
    journal = JournalHandler(writer)
    emitted = 0
    while journal.dropped < 5:  # had it waited, this would never end
        journal.emit(record("x" * 500))
        emitted += 1
        assert emitted < 10_000
    assert os.get_blocking(writer)  # others write there too
    drain(reader)
    journal.emit(record("again"))
    journal.emit(record("and again"))
    journal.close()
    assert drain(reader) == b"again (5 earlier lines were dropped: the output was not read)\nand again\n"


def test_a_file_gets_every_line_behind_what_others_wrote(tmp_path: Path) -> None:
    with (tmp_path / "log").open("wb", buffering=0) as file:
        journal = JournalHandler(file.fileno())
        file.write(b"first\n")
        journal.emit(record("second \udcff"))
        journal.close()
        file.write(b"third\n")
    assert (tmp_path / "log").read_bytes() == b"first\nsecond \\udcff\nthird\n"


def written(tmp_path: Path, records: list[logging.LogRecord]) -> list[str]:
    """The lines of the log after these records."""
    with (tmp_path / "log").open("wb", buffering=0) as file:
        journal = JournalHandler(file.fileno())
        for one in records:
            journal.handle(one)
        journal.close()
    return (tmp_path / "log").read_text().splitlines()


def test_a_flood_of_lines_from_one_place_becomes_one_line_in_ten_seconds(tmp_path: Path) -> None:
    lines = written(tmp_path, [record(f"flood {n}", n / 256) for n in range(30 * 256)])
    assert len(lines) == BURST + 2
    assert lines[0] == "flood 0"
    assert re.fullmatch(r"flood 512\d \(25\d\d more lines of this kind were dropped\)", lines[-1])
