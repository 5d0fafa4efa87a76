"""Writing beside the touch: nothing waits, nothing raises, and a disk that fails ends the recording with one line."""

from __future__ import annotations

import logging
import os
import threading
from pathlib import Path

import pytest
from machine_bench import PLATE, SLIPPERY, START_NS, STICKY, Bench, lines, references

from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.errors import RecordingError
from hapticd.files.recording import files, writer
from hapticd.files.recording.files import RecordingFile
from hapticd.files.recording.header import header_of
from hapticd.files.recording.reader import open_recording
from hapticd.files.recording.stream import Stream
from hapticd.files.recording.writer import Writer
from hapticd.tools.record.replay import replay


@pytest.fixture
def stream(strokes: Path) -> Stream:
    return Stream(open_recording(strokes).header)


@pytest.fixture(autouse=True)
def _looks_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "LOOK_EVERY_S", 0.001)
    monkeypatch.setattr(files.os, "fsync", lambda _: None)  # a busy disk takes its time


def test_what_was_put_is_there_after_the_end(tmp_path: Path, stream: Stream) -> None:
    path = tmp_path / "a.hrec"
    beside = Writer(RecordingFile(path, stream.opening()), stream)
    for t_ns in range(500):
        beside.put("timer", t_ns)
    beside.close(500, "over")

    records = list(open_recording(path).records())
    assert [record.t_ns for record in records[:-1]] == list(range(500))
    assert records[-1].fields == (500, "over")


def test_an_existing_recording_is_never_written_over(tmp_path: Path, stream: Stream) -> None:
    path = tmp_path / "a.hrec"
    path.write_bytes(b"precious")
    made = [RecordingFile(path, stream.opening()) for _ in range(2)]
    for file in made:
        file.close()

    assert path.read_bytes() == b"precious"
    assert [file.path.name for file in made] == ["a-2.hrec", "a-3.hrec"]


@pytest.mark.parametrize("folder", [".", "/", ".."])
def test_a_folder_is_no_file_to_record_to(folder: str, stream: Stream) -> None:
    with pytest.raises(RecordingError, match="is a folder: name a file in it"):
        RecordingFile(Path(folder), stream.opening())


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path: Path, stream: Stream) -> None:
    with pytest.raises(RecordingError, match="no recording can be written there"):
        RecordingFile(tmp_path / "no" / "folder.hrec", stream.opening())


def test_a_full_disk_ends_the_recording_with_one_line_and_the_touch_goes_on(
    stream: Stream, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_over = threading.Event()
    monkeypatch.setattr(RecordingFile, "_open", _open_full)
    beside = Writer(RecordingFile(Path("/dev/full"), b""), stream, on_end=is_over.set)
    bench = Bench(SLIPPERY, STICKY, observer=lambda _: beside.put)
    with caplog.at_level(logging.WARNING):
        bench.driven()
        assert is_over.wait(10.0)
        before = len(bench.board.heard)
        bench.run(100)
        beside.close(bench.t_ns, "over")

    assert beside.is_over
    assert [line for line in lines(caplog) if "recording" in line] == [
        "recording: it ends here, the touch goes on: /dev/full: No space left on device"
    ]
    assert len(references(bench.board.heard[before:])) > 0


def _open_full(file: RecordingFile, _: bytes) -> None:
    """The device that refuses every byte as a full disk does, in place of a new file."""
    file._fd = os.open("/dev/full", os.O_WRONLY)
    file._paths.append(Path("/dev/full"))
    file._bytes = file._opening_bytes = 0


def test_a_slow_disk_ends_the_recording_and_nobody_waits(
    tmp_path: Path, stream: Stream, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, goes_on = threading.Event(), threading.Event()
    file = RecordingFile(tmp_path / "slow.hrec", stream.opening())

    def hang(_: bytes) -> None:
        hangs.set()
        assert goes_on.wait(10.0)

    monkeypatch.setattr(file, "write", hang)
    monkeypatch.setattr(writer, "MAX_WAITING", 100)
    beside = Writer(file, stream)
    beside.put("timer", 0)
    assert hangs.wait(10.0)
    with caplog.at_level(logging.WARNING):
        for t_ns in range(1000):
            beside.put("timer", t_ns)
    goes_on.set()
    beside.close(0, "over")

    assert beside.is_over
    assert len(lines(caplog)) == 1
    assert len(beside._queue) == 0


def test_large_messages_fill_the_queue_by_their_size(
    tmp_path: Path, stream: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "LOOK_EVERY_S", 60.0)
    monkeypatch.setattr(writer, "MAX_WAITING", 1000)
    beside = Writer(RecordingFile(tmp_path / "a.hrec", stream.opening()), stream)
    for t_ns in range(15):
        beside.put("targets", t_ns, bytes(65536), "uid 7")
    assert not beside.is_over
    beside.put("targets", 16, bytes(65536), "uid 7")
    assert beside.is_over
    beside.close(0, "over")


def test_a_full_file_is_followed_and_the_oldest_goes(tmp_path: Path, stream: Stream) -> None:
    opening = len(stream.opening())
    file = RecordingFile(tmp_path / "a.hrec", stream.opening(), max_bytes=opening + 1000, max_files=3)
    beside = Writer(file, stream)
    for t_ns in range(400):
        beside.put("timer", t_ns)
    beside.close(400, "over")
    kept = sorted(tmp_path.iterdir(), key=lambda path: int(path.stem.removeprefix("a-")))

    assert len(kept) == 3
    assert all(path.stat().st_size <= opening + 1000 for path in kept)
    recording = open_recording(kept)
    records = list(recording.records())
    assert [record.t_ns for record in records] == list(range(401 - len(records), 401))
    assert not recording.losses.any
    assert not recording.is_whole


def test_a_recording_in_parts_is_replayed_as_one(tmp_path: Path) -> None:
    parts = tmp_path / "a.hrec"
    made: list[Writer] = []

    def observer(machine: Machine) -> Observer:
        stream = Stream(header_of(machine, PLATE, t_ns=START_NS, utc="", is_whole=True))
        file = RecordingFile(parts, stream.opening(), max_bytes=len(stream.opening()) + 4000, max_files=99)
        made.append(Writer(file, stream))
        return made[0].put

    bench = Bench(SLIPPERY, STICKY, observer=observer)
    bench.driven()
    made[0].close(bench.t_ns, "over")
    files = [path for path in (parts, *(tmp_path / f"a-{n}.hrec" for n in range(2, 99))) if path.exists()]

    assert len(files) > 2
    assert replay(open_recording(files)).is_identical
    with pytest.raises(RecordingError, match="begins when the daemon ran already"):
        replay(open_recording(files[1:]))
    with pytest.raises(RecordingError, match="in their order"):
        list(open_recording([files[0], files[2], files[1]]).records())


def test_a_file_that_may_not_be_followed_ends_when_it_is_full(
    tmp_path: Path, stream: Stream, caplog: pytest.LogCaptureFixture
) -> None:
    is_over = threading.Event()
    file = RecordingFile(tmp_path / "a.hrec", stream.opening(), max_bytes=len(stream.opening()) + 500)
    with caplog.at_level(logging.WARNING):
        beside = Writer(file, stream, on_end=is_over.set)
        for t_ns in range(400):
            beside.put("timer", t_ns)
        assert is_over.wait(10.0)
        beside.close(0, "over")

    assert len(lines(caplog)) == 1
    assert 0 < sum(1 for _ in open_recording(tmp_path / "a.hrec").records()) < 30
