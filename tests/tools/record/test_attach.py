"""`hapticd record`: a running daemon sends its records to attached recorders, and encodes nothing without one."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from pathlib import Path

import pytest
import zmq
from asynchronous import asynchronous
from machine_bench import SLIPPERY, START_NS, STICKY, Bench
from mcap.reader import make_reader

from hapticd.__main__ import main
from hapticd.board_protocol import BoardState
from hapticd.config.sections import RecordConfig, SimConfig
from hapticd.daemon.machine import Machine
from hapticd.daemon.recorder import RESTART_EVERY_NS, Recorders, header_of
from hapticd.errors import RecordingError
from hapticd.files.recording.header import Header, header_from
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.io.clients.record_socket import NOW, WAITS, WHOLE, RecordSocket
from hapticd.sim.rig.sockets import RigSockets
from hapticd.tools.record.attach import _decoded, record
from hapticd.tools.record.replay import replay

STEP_S = 0.001
QUIET, TOOL = BoardState.QUIET.value, BoardState.TOOL.value


def header(machine: Machine, is_whole: bool) -> Header:
    return header_of(machine, t_ns=START_NS, utc="", is_whole=is_whole)


def recorders(bench: Bench, directory: Path, config: RecordConfig | None = None) -> Recorders:
    return Recorders(bench.machine, config or RecordConfig(), directory, header)


async def served(bench: Bench, ours: Recorders, until: threading.Thread) -> list[bool]:
    """Steps the bench's time while the loop runs; returns whether its machine had an observer, step by step."""
    ours.start(asyncio.get_running_loop())
    observed = [bench.machine.observer is not None]
    until.start()
    while until.is_alive():
        bench.run(1)
        ours.sweep()
        observed.append(bench.machine.observer is not None)
        await asyncio.sleep(STEP_S)
    while ours._live is not None:
        ours.sweep()
        await asyncio.sleep(STEP_S)
    observed.append(bench.machine.observer is not None)
    ours.close(bench.t_ns)
    return observed


def test_records_are_encoded_from_when_a_recorder_attaches_until_it_detaches(tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    ours = recorders(bench, tmp_path)
    reports: list[str] = []
    thread = threading.Thread(target=lambda: reports.append(record(tmp_path / "a.mcap", tmp_path, 0.5, is_now=True)))
    observed = asyncio.run(served(bench, ours, thread))

    recording = open_recording(tmp_path / "a.mcap")
    kinds = [one.kind for one in recording.records()]
    assert (observed[0], observed[-1]) == (False, False)
    assert any(observed)
    assert {"reports", "pass", "written", "timer"} <= set(kinds)
    assert not recording.losses.any
    assert reports[0].startswith(f"{tmp_path / 'a.mcap'}: {len(kinds)} records of ")
    assert not (tmp_path / "record").exists()
    with pytest.raises(RecordingError, match="begins when the daemon ran already"):
        replay(recording)


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_a_recording_with_its_index_also_behind_an_ampersand(ending: int, tmp_path: Path) -> None:
    """A shell has SIGINT ignored in what it starts with `&`."""
    bench = Bench(SLIPPERY, STICKY).driven()
    ours = recorders(bench, tmp_path)
    script = 'trap "" INT; exec "$@"'
    command = [sys.executable, "-m", "hapticd", "record", tmp_path / "a.mcap", "--now", "--endpoint", tmp_path]
    ended: list[tuple[str, int]] = []

    def run() -> None:
        process = subprocess.Popen(["sh", "-c", script, "sh", *command], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        process.stdout.readline()  # it has begun
        process.send_signal(ending)
        ended.append((process.communicate(timeout=60)[0], process.returncode))

    asyncio.run(served(bench, ours, threading.Thread(target=run)))
    assert ended[0][1] == 0
    assert "a.mcap: " in ended[0][0]
    with (tmp_path / "a.mcap").open("rb") as file:
        assert make_reader(file).get_summary() is not None


def test_the_daemons_own_file_goes_on_beside_a_recorder_and_replays(tmp_path: Path) -> None:
    config = RecordConfig(file=str(tmp_path / "own.mcap"))
    ours: list[Recorders] = []

    def observer(machine: object) -> object:
        ours.append(Recorders(machine, config, tmp_path, header))  # type: ignore[arg-type]
        return machine.observer  # type: ignore[attr-defined]

    bench = Bench(SLIPPERY, STICKY, observer=observer)  # type: ignore[arg-type]
    bench.driven()
    thread = threading.Thread(target=lambda: record(tmp_path / "a.mcap", tmp_path, 0.3))
    observed = asyncio.run(served(bench, ours[0], thread))

    assert all(observed)
    own, other = (list(open_recording(tmp_path / name).records()) for name in ("own.mcap", "a.mcap"))
    lines = [one.fields for one in own if one.kind == "written"]
    assert [one.fields for one in other if one.kind == "written" and one.fields not in lines] == []
    assert replay(open_recording(tmp_path / "own.mcap")).is_identical


@asynchronous
async def test_a_recorder_ends_with_its_daemon(tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    ours = recorders(bench, tmp_path)
    thread = threading.Thread(target=lambda: record(tmp_path / "a.mcap", tmp_path, 60.0, is_now=True))
    ours.start(asyncio.get_running_loop())
    thread.start()
    while ours._live is None:
        ours.sweep()
        await asyncio.sleep(STEP_S)
    bench.run(3000)  # more than the kernel buffers
    bench.machine.stop(bench.t_ns)
    ours.close(bench.t_ns)
    await asyncio.to_thread(thread.join, 20.0)
    records = list(open_recording(tmp_path / "a.mcap").records())
    assert [one.seq for one in records] == [*range(len(records))]
    assert [one.kind for one in records[-3:]] == ["stop", "written", "end"]


class Wire:
    """Takes the place of the record socket: what is sent, in order, and calls for recorders that attach and detach."""

    def __init__(self, ours: Recorders, monkeypatch: pytest.MonkeyPatch) -> None:
        self.sent: list[bytes] = []
        monkeypatch.setattr(RecordSocket, "send", lambda _, record: self.sent.append(record))
        self.attach = ours._on_recorder


def test_the_core_restarts_for_a_waiting_recorder_and_not_again_within_some_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench()
    ours = recorders(bench, tmp_path)
    wire = Wire(ours, monkeypatch)
    assert not ours.is_due(bench.t_ns)

    wire.attach(WHOLE, True)
    assert wire.sent == [WAITS]
    assert ours.is_due(bench.t_ns)
    assert ours.report() == {"waits": True}
    assert bench.machine.observer is None
    second = Bench().machine
    ours.begin(second, bench.t_ns)
    assert second.observer is not None
    assert not ours.waits
    assert ours.report() == {"attached": {"is_whole": True, "bytes": len(wire.sent[1]), "dropped": 0}}
    wire.attach(WHOLE, True)  # another: it joins
    assert len(wire.sent) == 3
    wire.attach(WHOLE, False)
    assert second.observer is None

    wire.attach(WHOLE, True)
    assert not ours.is_due(bench.t_ns + RESTART_EVERY_NS - 1)
    assert ours.is_due(bench.t_ns + RESTART_EVERY_NS)
    wire.attach(WHOLE, False)
    assert not ours.is_due(bench.t_ns + RESTART_EVERY_NS)


def test_a_recording_is_not_ended_by_a_recorder_that_attaches_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench()
    own = recorders(bench, tmp_path, RecordConfig(file=str(tmp_path / "own.mcap")))
    wire = Wire(own, monkeypatch)
    wire.attach(WHOLE, True)
    assert not own.waits
    opening = _decoded(wire.sent[0])
    assert opening is not None
    assert not header_from(opening.fields).is_whole
    assert {*own.report()} == {"file", "attached"}
    wire.attach(WHOLE, False)
    own.close(bench.t_ns)

    ours = recorders(bench, tmp_path)
    ours._on_recorder(NOW, True)
    ours._on_recorder(WHOLE, True)
    assert not ours.waits
    ours._on_recorder(NOW, False)
    assert ours._live is not None  # the other one is still there


def test_fingers_targets_a_board_tool_and_a_latched_fault_use_a_machine() -> None:
    bench = Bench()
    bench.run(200)
    assert bench.machine.is_unused
    bench.ask("set", client="test", ttl_s=0.5, virtuals=[{"name": "rests", "path_mm": [[0, 0]]}])  # moves nothing
    assert not bench.machine.is_unused
    bench.run(600)
    assert bench.machine.is_unused
    bench.board.state = TOOL
    bench.board.status()
    bench.run(10)
    assert not bench.machine.is_unused

    bench.board.latch(3)
    bench.run(10)
    bench.board.state, bench.board.fault_code, bench.board.boot_id = QUIET, 0, 99
    bench.machine.board_link(False, "pulled", bench.t_ns)
    bench.machine.board_link(True, "back", bench.t_ns)
    bench.run(500)
    assert not bench.machine.is_unused
    assert bench.ask("clear_fault")["ok"]
    bench.run(200)
    assert bench.machine.is_unused

    touched = Bench(SLIPPERY, STICKY).driven()
    assert not touched.machine.is_unused


def test_without_a_place_for_its_file_the_daemon_goes_on(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(SLIPPERY)
    recorders(bench, tmp_path, RecordConfig(file=str(tmp_path / "no" / "where.mcap")))

    assert bench.machine.observer is None
    assert [one.getMessage() for one in caplog.records if "the touch goes on" in one.getMessage()]


def test_a_file_that_cannot_be_made_is_refused_before_a_daemon_is_asked(tmp_path: Path) -> None:
    for out in (tmp_path / "no" / "a.mcap", tmp_path):
        with pytest.raises(RecordingError, match=f"^{out}: "):
            record(out, tmp_path, 0.1)


def test_the_simulated_fingers_are_lifted_while_the_core_cannot_restart(tmp_path: Path) -> None:
    rig = Path(tempfile.mkdtemp(dir=tmp_path))
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.machine.config = replace(bench.machine.config, sim=SimConfig(rig_dir=str(rig)))
    ours = recorders(bench, tmp_path)
    asked: list[object] = []

    def lifts() -> None:
        pad = RigSockets(rig)
        recorder = threading.Thread(target=lambda: record(tmp_path / "a.mcap", tmp_path, 0.1, wait_s=0.5), daemon=True)
        recorder.start()
        while recorder.is_alive():
            asked.extend(touches.fingers for touches in pad.held())
            recorder.join(STEP_S)
        pad.close()

    asyncio.run(asyncio.wait_for(served(bench, ours, threading.Thread(target=lifts, daemon=True)), 20.0))
    assert len(asked) > 2
    assert set(asked) == {None}
    assert not open_recording(tmp_path / "a.mcap").is_whole


def test_no_daemon_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapticd.tools.record.attach.HEADER_WITHIN_S", 0.05)

    assert main(["record", str(tmp_path / "a.mcap"), "--endpoint", str(tmp_path)]) == 1
    assert "No hapticd answers" in capsys.readouterr().err
    assert not (tmp_path / "a.mcap").exists()


@asynchronous
async def test_a_recorder_that_attaches_and_detaches_all_the_time_makes_few_headers(tmp_path: Path) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    made: list[bool] = []

    def counted(machine: Machine, is_whole: bool) -> Header:
        made.append(is_whole)
        return header(machine, is_whole)

    ours = Recorders(bench.machine, RecordConfig(), tmp_path, counted)

    ours.start(asyncio.get_running_loop())
    with zmq.Context() as context, context.socket(zmq.XSUB) as socket:
        socket.linger = 0
        socket.connect(f"ipc://{tmp_path / 'record'}")
        for _ in range(200):
            socket.send(b"\x01")
            socket.send(b"\x00")
        socket.send(b"\x01")
        async with asyncio.timeout(30.0):
            while await asyncio.to_thread(socket.poll, 20) == 0 or ours._live is None:  # it may have to reconnect
                ours.sweep()
    ours.close(bench.t_ns)
    assert 1 <= len(made) <= 2 + 401 // 64
