"""The service's wiring in one process: what starts, in which order it ends, and what a failed start leaves behind."""

from __future__ import annotations

import asyncio
import os
import pty
import signal
import socket
import tty
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.daemon import Daemon, now_ns
from hapticd.daemon.lifecycle import serve
from hapticd.daemon.machine import TIMER_NS
from hapticd.daemon.service import load_modes
from hapticd.errors import AlreadyRunningError, ConfigError, HapticdError
from hapticd.io.devices.socket_trackpad import SocketTrackpad
from hapticd.io.host import cpu_latency as awake
from hapticd.io.host.systemd import Notifier
from hapticd.values import Finger, RawReport, Tick
from hapticd.wire import device
from hapticd_client import Client

PATIENCE_S = 10.0


def sine_plate() -> ModeShapes:
    axis_mm = np.linspace(-68.75, 68.75, 56)
    wave = np.sin(2 * np.pi * axis_mm / 27.0)
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([np.tile(wave, (56, 1)), np.tile(wave, (56, 1)).T]))


MODES = sine_plate()
CONFIG = Config()
STAY_AWAKE = replace(CONFIG, realtime=replace(CONFIG.realtime, stay_awake=True))


class Hardware:
    """A terminal that hears the daemon and an endpoint that it may connect to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        (folder / "board").symlink_to(os.ttyname(self._slave))
        self.pad = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.pad.bind(str(folder / "trackpad"))
        self.pad.listen()

    def daemon(self, runtime: str = "run", notifier: Notifier | None = None, config: Config = CONFIG) -> Daemon:
        trackpad, port = SocketTrackpad(self.folder / "trackpad"), str(self.folder / "board")
        return Daemon(config, self.folder / runtime, board_port=port, trackpad=trackpad, notifier=notifier)

    def heard(self) -> bytes:
        try:
            return os.read(self.master, 1 << 16)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)
        self.pad.close()


@pytest.fixture
def hardware(tmp_path: Path) -> Iterator[Hardware]:
    made = Hardware(tmp_path)
    yield made
    made.close()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.002)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_serving_and_frees_the_directory(hardware: Hardware, number: signal.Signals) -> None:
    async def story() -> None:
        service = hardware.daemon()
        serving = asyncio.create_task(serve(service, MODES))
        await until(lambda: (hardware.folder / "run" / "control").is_socket())
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)  # an impatient person
        await asyncio.wait_for(serving, PATIENCE_S)
        assert sorted(os.listdir(hardware.folder / "run")) == ["lock"]

    asyncio.run(story())


def test_the_board_is_greeted_as_soon_as_the_service_starts(hardware: Hardware) -> None:
    async def story() -> None:
        service = hardware.daemon()
        service.start(asyncio.get_running_loop(), MODES)
        assert hardware.heard() == b"\0" + device.encode_hello_request()
        await service.stop()

    asyncio.run(story())


def test_a_hang_up_with_a_sound_configuration_ends_serving_with_what_shall_follow(hardware: Hardware) -> None:
    async def story() -> str | None:
        async def reread() -> str:
            return "the next"

        serving = asyncio.create_task(serve(hardware.daemon(), MODES, reread))
        await until(lambda: (hardware.folder / "run" / "control").is_socket())
        os.kill(os.getpid(), signal.SIGHUP)
        return await asyncio.wait_for(serving, PATIENCE_S)

    assert asyncio.run(story()) == "the next"
    assert sorted(os.listdir(hardware.folder / "run")) == ["lock"]


def test_a_hang_up_with_a_bad_configuration_is_one_line_and_changes_nothing(
    hardware: Hardware, caplog: pytest.LogCaptureFixture
) -> None:
    async def story() -> str | None:
        async def reread() -> str:
            raise ConfigError("hapticd.toml: limits is wrong.")

        serving = asyncio.create_task(serve(hardware.daemon(), MODES, reread))
        await until(lambda: (hardware.folder / "run" / "control").is_socket())
        for _ in range(2):  # the second shows that the first is over and done with
            caplog.clear()
            os.kill(os.getpid(), signal.SIGHUP)
            await until(lambda: "hapticd.toml: limits is wrong." in caplog.text)
        assert not serving.done()
        os.kill(os.getpid(), signal.SIGTERM)
        return await asyncio.wait_for(serving, PATIENCE_S)

    assert asyncio.run(story()) is None
    said = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert said == ["SIGHUP: hapticd.toml: limits is wrong. The present configuration stays."]


class Manager(Notifier):
    """Hears what a service manager would."""

    def __init__(self) -> None:
        super().__init__({})
        self.heard: list[str] = []

    def notify(self, **state: str | int) -> bool:
        self.heard += state
        return True

    def feed_watchdog(self, t_now_ns: int) -> None:
        assert t_now_ns > 0
        self.heard.append("watchdog")


def test_the_watchdog_is_fed_while_passes_succeed_and_not_while_they_fail(hardware: Hardware) -> None:
    async def story() -> None:
        manager = Manager()
        service = hardware.daemon(notifier=manager)
        service.start(asyncio.get_running_loop(), MODES)
        assert manager.heard == []
        service.ready()
        await until(lambda: manager.heard.count("watchdog") >= 3)
        assert manager.heard[:3] == ["ready", "status", "watchdog"]

        def fail(*_: object) -> Tick:
            raise RuntimeError("a bug")

        machine = service.machine
        machine._decide = fail  # type: ignore[method-assign]
        await until(lambda: machine.is_failing)
        fed, ticked = len(manager.heard), machine.status.loop.tick_late.count
        await until(lambda: machine.status.loop.tick_late.count >= ticked + 4)
        assert len(manager.heard) == fed
        del machine._decide
        await until(lambda: len(manager.heard) > fed)
        await service.stop()

    asyncio.run(story())


def test_reports_feed_the_watchdog_as_well_for_while_they_come_no_tick_does(hardware: Hardware) -> None:
    async def story() -> None:
        manager = Manager()
        service = hardware.daemon(notifier=manager)
        service.start(asyncio.get_running_loop(), MODES)
        service.ready()
        service._reports([RawReport(now_ns(), b"")])
        assert manager.heard == ["ready", "status", "watchdog"]
        service.machine._decide = None  # type: ignore[assignment]
        service._reports([RawReport(now_ns(), b"")])
        assert manager.heard == ["ready", "status", "watchdog"]
        await service.stop()

    asyncio.run(story())


def test_processors_are_kept_awake_from_the_first_touch_to_the_end_of_the_service(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch
) -> None:
    wishes = hardware.folder / "cpu_dma_latency"
    wishes.touch()
    monkeypatch.setattr(awake, "LATENCY_FILE", wishes)

    async def story() -> None:
        service = hardware.daemon(config=STAY_AWAKE)
        service.start(asyncio.get_running_loop(), MODES)
        service.go_real_time()
        assert service.machine.status.real_time["stays_awake"] is True
        service._reports([RawReport(now_ns(), b"")])
        assert wishes.read_bytes() == b""
        service.machine.pipeline._fingers.down = (Finger(1, 0, 0.0, 0.0, True),)
        service._reports([RawReport(now_ns(), b"")])
        assert wishes.read_bytes() == bytes(4)
        await service.stop()

    asyncio.run(story())


def test_a_wish_for_processors_awake_that_is_refused_is_told_and_the_service_goes_on(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(awake, "LATENCY_FILE", hardware.folder / "none")

    async def story() -> None:
        service = hardware.daemon(config=STAY_AWAKE)
        service.start(asyncio.get_running_loop(), MODES)
        service.go_real_time()
        assert service.machine.status.real_time["stays_awake"] is False
        assert service.machine.status.real_time["refused"] == (f"{awake.LATENCY_FILE}: No such file or directory",)
        service._reports([RawReport(now_ns(), b"")])
        await service.stop()

    asyncio.run(story())


def test_nobody_touching_halves_the_ticks_and_each_is_accounted_for(hardware: Hardware) -> None:
    async def story() -> None:
        service = hardware.daemon()
        service.start(asyncio.get_running_loop(), MODES)
        loop = service.machine.status.loop
        await until(lambda: loop.tick_late.count >= 1)
        assert service.machine.is_idle
        assert service._timer.period_ns == 2 * TIMER_NS
        assert loop.tick_late.shortest_ns >= 0
        await service.stop()

    asyncio.run(story())


def test_each_batch_of_reports_is_timed_from_its_reading(hardware: Hardware) -> None:
    async def story() -> None:
        service = hardware.daemon()
        service.start(asyncio.get_running_loop(), MODES)
        pad, _ = await asyncio.to_thread(hardware.pad.accept)
        with pad:
            before = service.machine.status.loop.wait.count
            pad.send(b"\x02" + bytes(11))
            pad.send(b"\x02" + bytes(11))
            await until(lambda: service.machine.status.loop.wait.count > before)
        timing = service.machine.status.loop
        assert timing.wait.count == timing.compute.count
        assert timing.wait.count + timing.joined_reports == 2
        assert timing.wait.shortest_ns >= 0
        await service.stop()

    asyncio.run(story())


def test_after_a_stall_of_the_process_the_log_names_it_and_the_board_is_read_before_it_is_judged(
    hardware: Hardware, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def story() -> None:
        service = hardware.daemon()
        service.start(asyncio.get_running_loop(), MODES)
        await until(lambda: service._t_awake_ns is not None)
        calls: list[str] = []
        monkeypatch.setattr(service.machine, "timer", lambda _: calls.append("judged"))
        monkeypatch.setattr(service.machine, "board_bytes", lambda *_: calls.append("read"))
        os.write(hardware.master, b"a status of the meantime")
        assert service._t_awake_ns is not None
        service._t_awake_ns -= 2_000_000_000  # as after SIGSTOP and SIGCONT
        service._on_timer(0, 0)
        assert calls == ["read", "judged"]
        service._on_timer(0, 0)
        monkeypatch.undo()
        await service.stop()

    asyncio.run(story())
    warnings = [record.getMessage() for record in caplog.records if "did not run" in record.getMessage()]
    assert warnings == ["this process did not run for 2.0 s: it was stopped, or the host was busy or asleep"]


def test_a_second_daemon_is_refused_in_its_own_words_and_opens_no_device(hardware: Hardware) -> None:
    async def story() -> None:
        first, second = hardware.daemon(), hardware.daemon()
        first.start(asyncio.get_running_loop(), MODES)
        hardware.heard()
        with pytest.raises(AlreadyRunningError):
            await serve(second, MODES)
        assert hardware.heard() == b""
        assert (hardware.folder / "run" / "control").is_socket()
        await first.stop()

    asyncio.run(story())


def test_a_daemon_that_never_started_can_be_stopped(hardware: Hardware) -> None:
    asyncio.run(hardware.daemon().stop())


def test_a_directory_with_too_long_a_name_is_refused_in_one_sentence(hardware: Hardware) -> None:
    with pytest.raises(HapticdError, match="a socket allows 107"):
        asyncio.run(serve(hardware.daemon("r" * 100), MODES))


def test_telemetry_is_built_while_somebody_listens(hardware: Hardware) -> None:
    async def story() -> None:
        service = hardware.daemon()
        service.start(asyncio.get_running_loop(), MODES)
        machine = service.machine
        await until(lambda: machine.session is not None and machine.last_tick is not None)
        assert machine.status.published == 0
        client = await asyncio.to_thread(Client, hardware.folder / "run", timeout_s=PATIENCE_S)
        assert await asyncio.to_thread(client.fingers, PATIENCE_S) == []
        assert machine.status.published > 0
        await asyncio.to_thread(client.close)
        await until(lambda: machine.status.publish is None)
        await service.stop()

    asyncio.run(story())


def test_each_start_has_an_instance_of_its_own(hardware: Hardware) -> None:
    async def story() -> set[int]:
        instances = set()
        for _ in range(3):
            service = hardware.daemon()
            service.start(asyncio.get_running_loop(), MODES)
            instances.add(service.machine.instance)
            await service.stop()
        return instances

    assert len(asyncio.run(story())) == 3


def test_the_mode_shapes_are_those_of_the_file(tmp_path: Path) -> None:
    MODES.save(tmp_path / "modes.npz")
    config = Config()
    config = replace(config, plate=replace(config.plate, modes_file=str(tmp_path / "modes.npz")))
    assert load_modes(config).M == 2
    config = replace(config, limits=replace(config.limits, w_limit_um=(4.0,)))
    with pytest.raises(ConfigError, match="has 1 limits for a plate of 2 modes: give one for each mode"):
        load_modes(config)


def test_tcp_without_keys_is_refused_at_start_with_a_sentence_that_says_how_to_make_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "hapticd.toml"
    config.write_text('[client]\ntcp = "127.0.0.1:7410"\n', encoding="utf-8")
    assert main(["run", "--config", str(config)]) == 78
    assert "client.tcp: needs keys: make them with `hapticd keys make`" in capsys.readouterr().err
    config.write_text('[client]\ntcp = "127.0.0.1:7410"\nkeys_dir = "keys"\n', encoding="utf-8")
    assert main(["run", "--config", str(config)]) == 78
    assert f"run `hapticd keys make {tmp_path / 'keys'}`" in capsys.readouterr().err
    assert main(["keys", "make", str(tmp_path / "keys")]) == 0
    assert main(["run", "--config", str(config)]) == 78
    assert "the allow-list is empty" in capsys.readouterr().err


def test_what_corrects_the_pad_runs_with_the_service_and_ends_with_it(hardware: Hardware) -> None:
    async def story() -> list[object]:
        config = replace(CONFIG, trackpad=replace(CONFIG.trackpad, correct_while_touched=True))
        daemon = hardware.daemon(config=config)
        daemon.start(asyncio.get_running_loop(), MODES)
        calibration = daemon.machine.status.calibration
        assert daemon.machine.observer is not None
        running = calibration()["running"]
        await daemon.stop()
        return [running, calibration()["running"]]

    assert asyncio.run(story()) == [True, False]


def test_by_default_nothing_corrects_the_pad(hardware: Hardware) -> None:
    async def story() -> None:
        daemon = hardware.daemon()
        daemon.start(asyncio.get_running_loop(), MODES)
        assert daemon.machine.observer is None
        assert daemon.machine.status.calibration() == {}
        await daemon.stop()

    asyncio.run(story())
