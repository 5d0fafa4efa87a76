"""`hapticd record`: a running daemon tells all that it does to whoever asks, and builds nothing while nobody does."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest
import zmq
from machine_bench import PLATE, SLIPPERY, START_NS, STICKY, Bench

from hapticd.__main__ import main
from hapticd.config import RecordConfig
from hapticd.errors import RecordingError
from hapticd.recording.attach import record
from hapticd.recording.header import Header, header_of
from hapticd.recording.reader import open_recording
from hapticd.recording.replay import replay
from hapticd.recording.service import Recorders

STEP_S = 0.001


def recorders(bench: Bench, directory: Path, config: RecordConfig) -> Recorders:
    def header(is_whole: bool) -> Header:
        return header_of(bench.machine, PLATE, t_ns=bench.t_ns, utc="", is_whole=is_whole)

    return Recorders(bench.machine, config, directory, header)


async def served(bench: Bench, ours: Recorders, until: threading.Thread) -> list[bool]:
    """The bench's time goes on beside the loop; whether its machine had a tap, step by step."""
    ours.start(asyncio.get_running_loop())
    tapped = [bench.machine.tap is not None]
    until.start()
    while until.is_alive():
        bench.run(1)
        ours.sweep()
        tapped.append(bench.machine.tap is not None)
        await asyncio.sleep(STEP_S)
    while ours.is_live:
        ours.sweep()
        await asyncio.sleep(STEP_S)
    tapped.append(bench.machine.tap is not None)
    ours.close(bench.t_ns)
    return tapped


def test_a_recorder_gets_everything_from_when_it_came_and_nothing_is_made_without_one(tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    ours = recorders(bench, tmp_path, RecordConfig())
    said: list[str] = []
    thread = threading.Thread(target=lambda: said.append(record(tmp_path / "a.hrec", tmp_path, 0.5)))
    tapped = asyncio.run(served(bench, ours, thread))

    recording = open_recording(tmp_path / "a.hrec")
    kinds = [one.kind for one in recording.records()]
    assert (tapped[0], tapped[-1]) == (False, False)
    assert any(tapped)
    assert {"reports", "pass", "written", "timer"} <= set(kinds)
    assert not recording.losses.any
    assert said[0].startswith(f"{tmp_path / 'a.hrec'}: {len(kinds)} records of ")
    assert not (tmp_path / "record").exists()
    with pytest.raises(RecordingError, match="begins when the daemon ran already"):
        replay(recording)


def test_the_daemons_own_file_goes_on_beside_a_recorder_and_replays(tmp_path: Path) -> None:
    config = RecordConfig(file=str(tmp_path / "own.hrec"))
    ours: list[Recorders] = []

    def tap(machine: object) -> object:
        def header(is_whole: bool) -> Header:
            return header_of(machine, PLATE, t_ns=START_NS, utc="", is_whole=is_whole)  # type: ignore[arg-type]

        ours.append(Recorders(machine, config, tmp_path, header))  # type: ignore[arg-type]
        return machine.tap  # type: ignore[attr-defined]

    bench = Bench(SLIPPERY, STICKY, tap=tap)  # type: ignore[arg-type]
    bench.driven()
    thread = threading.Thread(target=lambda: record(tmp_path / "a.hrec", tmp_path, 0.3))
    tapped = asyncio.run(served(bench, ours[0], thread))

    assert all(tapped)
    own, other = (list(open_recording(tmp_path / name).records()) for name in ("own.hrec", "a.hrec"))
    lines = [one.fields for one in own if one.kind == "written"]
    assert [one.fields for one in other if one.kind == "written" and one.fields not in lines] == []
    assert replay(open_recording(tmp_path / "own.hrec")).is_identical


def test_a_recorder_ends_with_its_daemon(tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    ours = recorders(bench, tmp_path, RecordConfig())
    thread = threading.Thread(target=lambda: record(tmp_path / "a.hrec", tmp_path, 60.0))

    async def stops() -> None:
        ours.start(asyncio.get_running_loop())
        thread.start()
        while not ours.is_live:
            ours.sweep()
            await asyncio.sleep(STEP_S)
        bench.run(50)
        bench.machine.stop(bench.t_ns)
        await asyncio.sleep(STEP_S)
        ours.close(bench.t_ns)

    asyncio.run(stops())
    thread.join(20.0)
    kinds = [one.kind for one in open_recording(tmp_path / "a.hrec").records()]
    assert "stop" in kinds
    assert kinds[-1] == "end"


def test_without_a_place_for_its_file_the_daemon_goes_on(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(SLIPPERY)
    recorders(bench, tmp_path, RecordConfig(file=str(tmp_path / "no" / "where.hrec")))

    assert bench.machine.tap is None
    assert [one.getMessage() for one in caplog.records if "the touch goes on" in one.getMessage()]


def test_no_daemon_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapticd.recording.attach.HEADER_WITHIN_S", 0.05)

    assert main(["record", str(tmp_path / "a.hrec"), "--runtime-dir", str(tmp_path)]) == 2
    assert "No hapticd answers" in capsys.readouterr().err
    assert not (tmp_path / "a.hrec").exists()


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf"])
def test_a_senseless_time_is_one_sentence(seconds: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", str(tmp_path / "a.hrec"), f"--seconds={seconds}"]) == 2
    assert "--seconds" in capsys.readouterr().err


def test_who_comes_and_goes_all_the_time_makes_few_headers(tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    made: list[bool] = []

    def header(is_whole: bool) -> Header:
        made.append(is_whole)
        return header_of(bench.machine, PLATE, t_ns=bench.t_ns, utc="", is_whole=is_whole)

    ours = Recorders(bench.machine, RecordConfig(), tmp_path, header)

    async def harried() -> None:
        ours.start(asyncio.get_running_loop())
        context = zmq.Context()
        with context.socket(zmq.XSUB) as socket:
            socket.linger = 0
            socket.connect(f"ipc://{tmp_path / 'record'}")
            for _ in range(200):
                socket.send(b"\x01")
                socket.send(b"\x00")
            socket.send(b"\x01")
            while not ours.is_live or await asyncio.to_thread(socket.poll, 20) == 0:
                ours.sweep()
        context.term()
        ours.close(bench.t_ns)

    asyncio.run(asyncio.wait_for(harried(), 30.0))
    assert 1 <= len(made) <= 2 + 401 // 64
