"""The background writer: nothing waits, nothing raises, and a disk that fails ends the recording with one line."""

from __future__ import annotations

import errno
import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from asynchronous import wait_for
from machine_bench import SLIPPERY, START_NS, STICKY, Bench, lines, references

from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.recorder import header_of
from hapticd.errors import RecordingError
from hapticd.files.recording import background, mcap_writer
from hapticd.files.recording.background import BackgroundWriter
from hapticd.files.recording.header import Header
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import RecordingFile
from hapticd.tools.record.replay import replay


@pytest.fixture(autouse=True)
def _looks_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "LOOK_EVERY_S", 0.001)
    monkeypatch.setattr(mcap_writer.os, "fsync", lambda _: None)  # a busy disk takes its time


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A file that refuses every byte behind its header."""
    full = os.open("/dev/full", os.O_WRONLY)
    honest, is_full = os.write, threading.Event()
    refusing = mcap_writer.RecordingFile._open

    def opens(file: RecordingFile, seq: int) -> None:
        refusing(file, seq)
        is_full.set()

    monkeypatch.setattr(RecordingFile, "_open", opens)
    monkeypatch.setattr(mcap_writer.os, "write", lambda fd, data: honest(full if is_full.is_set() else fd, data))
    yield
    is_full.clear()
    os.close(full)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_ends_the_recording_with_one_line_and_the_touch_goes_on(
    tmp_path: Path, header: Header, caplog: pytest.LogCaptureFixture
) -> None:
    writer = BackgroundWriter(RecordingFile(tmp_path / "a.mcap", header))
    bench = Bench(SLIPPERY, STICKY, observer=lambda _: writer.put)
    with caplog.at_level(logging.WARNING):
        bench.driven()
        wait_for(lambda: writer.is_over)
        before = len(bench.board.received)
        bench.run(100)
        writer.close(bench.t_ns, "over")

    assert [line for line in lines(caplog) if "recording" in line] == [
        f"recording: it ends here, the touch goes on: {tmp_path / 'a.mcap'}: No space left on device"
    ]
    assert len(references(bench.board.received[before:])) > 0


def test_a_slow_disk_ends_the_recording_and_nothing_waits(
    tmp_path: Path, header: Header, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, goes_on = threading.Event(), threading.Event()
    file = RecordingFile(tmp_path / "slow.mcap", header)

    def hang() -> None:
        hangs.set()
        assert goes_on.wait(10.0)

    monkeypatch.setattr(file, "sync", hang)
    monkeypatch.setattr(background, "MAX_WAITING", 100)
    writer = BackgroundWriter(file)
    assert hangs.wait(10.0)
    with caplog.at_level(logging.WARNING):
        for t_ns in range(1000):
            writer.put("timer", t_ns)
    goes_on.set()
    writer.close(0, "over")

    assert writer.is_over
    (line,) = lines(caplog)
    assert "the disk is too slow" in line
    assert len(writer._queue) == 0


def test_a_recording_in_parts_is_replayed_as_one(tmp_path: Path) -> None:
    made: list[BackgroundWriter] = []

    def observer(machine: Machine) -> Observer:
        header = header_of(machine, t_ns=START_NS, utc="", is_whole=True)
        file = RecordingFile(tmp_path / "a.mcap", header, max_files=99)
        file._max_bytes = file.written_bytes + file._index_bytes + 6_000
        made.append(BackgroundWriter(file))
        return made[0].put

    bench = Bench(SLIPPERY, STICKY, observer=observer)
    bench.driven()
    made[0].close(bench.t_ns, "over")
    paths = (tmp_path / "a.mcap", *(tmp_path / f"a-{number}.mcap" for number in range(2, 99)))
    files = [path for path in paths if path.exists()]

    assert len(files) > 2
    assert replay(open_recording(files)).is_identical
    with pytest.raises(RecordingError, match="begins when the daemon ran already"):
        replay(open_recording(files[1:]))


def test_where_no_file_can_follow_the_recording_ends_and_closes_no_file_of_others(
    tmp_path: Path, header: Header, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    others: list[int] = []
    file = RecordingFile(tmp_path / "a.mcap", header, max_files=2)
    file._max_bytes = file.written_bytes + file._index_bytes + 4_000

    def refuse() -> int:
        others.append(os.open(os.devnull, os.O_RDONLY))  # takes the number of the file that was closed
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(file, "_created", refuse)
    with caplog.at_level(logging.WARNING):
        writer = BackgroundWriter(file)
        for t_ns in range(400):
            writer.put("timer", t_ns)
        wait_for(lambda: writer.is_over)
        writer.close(0, "over")
    assert [line for line in lines(caplog) if "Permission denied" not in line] == []
    os.close(others[0])  # raises where it was closed
    assert sum(1 for _ in open_recording(tmp_path / "a.mcap").records()) > 0
