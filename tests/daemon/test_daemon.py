"""The service's wiring in one process: what starts, in which order it ends, and what a failed start leaves behind."""

from __future__ import annotations

import asyncio
import itertools
import os
import signal
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from asynchronous import PATIENCE_S, asynchronous, until
from machine_bench import PLATE
from terminal import Terminal

from hapticd.config.sections import Config
from hapticd.core.pipeline import OVERRUN_NS
from hapticd.daemon import daemon as daemons
from hapticd.daemon.daemon import Daemon, now_ns
from hapticd.daemon.lifecycle import serve
from hapticd.errors import AlreadyRunningError
from hapticd.io.devices.socket_trackpad import SocketTrackpad
from hapticd.io.host import cpu_latency as awake
from hapticd.io.host.realtime import Granted
from hapticd.io.host.runaway import RealtimeThrottle
from hapticd.io.host.systemd import Notifier
from hapticd.io.time_budget import TimeBudget
from hapticd.sim.fingers.paths import Rest, Touch
from hapticd.sim.fingers.sensor import SensorModel, SensorSettings
from hapticd.tools.service import SELF_TEST
from hapticd.values import RawReport, Tick

CONFIG = Config()
REAL_TIME = replace(CONFIG, realtime=replace(CONFIG.realtime, fifo_priority=1))


class Hardware:
    """A terminal at the daemon's line and an endpoint that it may connect to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.terminal = Terminal()
        (folder / "board").symlink_to(self.terminal.port)
        self.pad = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.pad.bind(str(folder / "trackpad"))
        self.pad.listen()

    def daemon(self, runtime: str = "run", notifier: Notifier | None = None, config: Config = CONFIG) -> Daemon:
        trackpad, port = SocketTrackpad(self.folder / "trackpad"), str(self.folder / "board")
        parts = {"board_port": port, "trackpad": trackpad, "self_test": SELF_TEST, "notifier": notifier}
        return Daemon(config, self.folder / runtime, **parts)

    @asynccontextmanager
    async def started(self, **arguments: Any) -> AsyncIterator[Daemon]:
        """A daemon from its start to its end."""
        daemon = self.daemon(**arguments)
        daemon.start(asyncio.get_running_loop(), PLATE)
        try:
            yield daemon
        finally:
            await daemon.stop()

    async def serving(self) -> asyncio.Task[Any]:
        """`serve` from when it serves clients."""
        task = asyncio.create_task(serve(self.daemon(), PLATE))
        await until((self.folder / "run" / "control").is_socket)
        return task

    def close(self) -> None:
        self.terminal.close()
        self.pad.close()


@pytest.fixture
def hardware(tmp_path: Path) -> Iterator[Hardware]:
    made = Hardware(tmp_path)
    yield made
    made.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@asynchronous
async def test_a_signal_ends_serving_and_frees_the_directory(hardware: Hardware, number: signal.Signals) -> None:
    serving = await hardware.serving()
    os.kill(os.getpid(), number)
    os.kill(os.getpid(), number)  # an impatient person
    await asyncio.wait_for(serving, PATIENCE_S)
    assert sorted(os.listdir(hardware.folder / "run")) == ["lock"]


class Manager(Notifier):
    """Hears what a service manager would."""

    def __init__(self) -> None:
        super().__init__({})
        self.received: list[str] = []

    def notify(self, **state: str | int) -> bool:
        self.received += state
        return True

    def feed_watchdog(self, t_now_ns: int) -> None:
        assert t_now_ns > 0
        self.received.append("watchdog")


@asynchronous
async def test_the_watchdog_is_fed_while_passes_succeed_and_not_while_they_fail(hardware: Hardware) -> None:
    manager = Manager()
    async with hardware.started(notifier=manager) as service:
        assert manager.received == []
        service.ready()
        await until(lambda: manager.received.count("watchdog") >= 3)
        assert manager.received[:3] == ["ready", "status", "watchdog"]

        def fail(*_: object) -> Tick:
            raise RuntimeError("a bug")

        machine = service.machine
        machine._decide = fail  # type: ignore[method-assign]
        await until(lambda: machine.is_failing)
        fed, ticked = len(manager.received), machine.status.loop.tick_late.count
        await until(lambda: machine.status.loop.tick_late.count >= ticked + 4)
        assert len(manager.received) == fed
        del machine._decide
        await until(lambda: len(manager.received) > fed)


@asynchronous
async def test_processors_are_kept_awake_from_the_first_touch_to_the_end_of_the_service(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch
) -> None:
    wishes = hardware.folder / "cpu_dma_latency"
    wishes.touch()
    monkeypatch.setattr(awake, "LATENCY_FILE", wishes)
    monkeypatch.setattr(daemons, "go_real_time", lambda **_: Granted(0, (), False, ()))  # this process goes on
    async with hardware.started(config=REAL_TIME) as service:
        service.go_real_time()
        assert service.machine.status.real_time["stays_awake"] is True
        service._reports([RawReport(now_ns(), b"")])
        assert wishes.read_bytes() == b""
        landing = SensorModel(SensorSettings(), 1).reports([Touch(Rest((0.0, 0.0)))], 0.1)
        service._reports([RawReport(now_ns(), report.data) for report in landing])
        assert wishes.read_bytes() == bytes(4)


@asynchronous
async def test_after_an_overrun_the_loop_sleeps_passes_do_less_and_it_is_counted(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ran_ns, slept_s = itertools.count(0, 2 * OVERRUN_NS), list[float]()
    async with hardware.started() as service:
        service._throttle = RealtimeThrottle(ran_ns=lambda: 0, sleep=slept_s.append)
        monkeypatch.setattr("hapticd.daemon.daemon.time.thread_time_ns", lambda: next(ran_ns))
        service._reports([RawReport(now_ns(), b"")])
        timing = service.machine.report_status(now_ns())["timing"]
        assert (timing["overruns"], timing["throttled"], len(slept_s)) == (1, 1, 1)
        assert timing["budget_frac"] == service.machine.pipeline.budget_frac == 0.5
    assert "1 passes put off" in caplog.text  # when it ends at the latest


@asynchronous
async def test_after_a_stall_the_log_names_it_and_the_board_is_read_before_a_verdict(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with hardware.started() as service:
        await until(lambda: service._t_awake_ns is not None)
        calls: list[str] = []
        monkeypatch.setattr(service.machine, "timer", lambda _: calls.append("judged"))
        monkeypatch.setattr(service.machine, "board_bytes", lambda *_: calls.append("read"))
        os.write(hardware.terminal.master, b"a status of the meantime")
        assert service._t_awake_ns is not None
        service._t_awake_ns -= 2_000_000_000  # as after SIGSTOP and SIGCONT
        service._on_timer(0, 0)
        assert calls == ["read", "judged"]
        service._on_timer(0, 0)
        monkeypatch.undo()
    warnings = [record.getMessage() for record in caplog.records if "did not run" in record.getMessage()]
    assert warnings == ["this process did not run for 2.0 s: it was stopped, or the host was busy or asleep"]


@asynchronous
async def test_a_second_daemon_is_refused_in_its_own_words_and_opens_no_device(hardware: Hardware) -> None:
    async with hardware.started():
        hardware.terminal.received()
        with pytest.raises(AlreadyRunningError) as refused:
            await serve(hardware.daemon(), PLATE)
        assert refused.value.exit_code == 75
        assert hardware.terminal.received() == b""
        assert (hardware.folder / "run" / "control").is_socket()


@asynchronous
async def test_reports_beyond_the_time_for_passes_are_one_batch_of_the_newest(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with hardware.started() as daemon:
        await until(lambda: daemon._pad_link is not None)
        taken: list[list[int]] = []
        monkeypatch.setattr(daemon, "_pass_reports", lambda batch: taken.append([one.t_host_ns for one in batch]))
        monkeypatch.setattr(daemon, "_reports_budget", TimeBudget(0.001, 1))
        for number in range(71):
            daemon._reports([RawReport(number, b"")])
        await until(lambda: len(taken) == 2)
        assert taken == [[0], list(range(7, 71))]
        assert daemon.machine.status.inputs() == {"trackpad": {"reports_left_out": 6}, "board": {"left_out": 0}}
