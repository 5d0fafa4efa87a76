"""The service: one asyncio loop that carries bytes between trackpad, board and clients, with `machine` in the middle.

Nothing on the loop blocks or computes for long. One event, one pass: reports, board bytes and client messages are
handled when they come, a timer keeps the board alive, and SIGTERM or SIGINT end in a quiet plate.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import os
import secrets
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from . import calibration
from .config import SIMULATED, Config
from .core.modes import ModeShapes
from .errors import ConfigError
from .io import keys
from .io.device import SerialLink
from .io.replay import ReplayTrackpad
from .io.server import ClientServer, runtime_directory
from .io.socketpad import SocketTrackpad
from .io.sockets import Remote
from .io.trackpad import HidTrackpad, TrackpadSource
from .machine import TIMER_NS, Machine
from .sim.plate import PlateSettings, PlateTruth
from .sim.rigprocess import RigProcess
from .values import ModeCalibration, RawReport

log = logging.getLogger("hapticd")

QUIET_WITHIN_S = 0.1  # how long the last frame may take to leave


class Daemon:
    """Everything that `hapticd run` opens, from `start` to `stop`."""

    def __init__(
        self,
        config: Config,
        runtime_dir: Path,
        *,
        board_port: str,
        trackpad: TrackpadSource,
        calibration: Sequence[ModeCalibration] = (),
        remote: Remote | None = None,
    ) -> None:
        self._config = config
        self._calibration = calibration
        self.runtime_dir = runtime_dir
        self._server = ClientServer(runtime_dir, remote)
        self._link = SerialLink(board_port, config.device.baud)
        self._trackpad = trackpad
        self._timer: asyncio.TimerHandle | None = None
        self._machine: Machine | None = None

    @property
    def machine(self) -> Machine:
        """The daemon's inside; from `start` on."""
        assert self._machine is not None, "start() comes first"
        return self._machine

    def start(self, loop: asyncio.AbstractEventLoop, modes: ModeShapes) -> None:
        """Serve clients first (it takes the lock that a second daemon stumbles over), then open the devices."""
        self._loop = loop
        machine = Machine(
            self._config,
            modes,
            write_board=self._link.write,
            instance=secrets.randbits(31),
            calibration=self._calibration,
        )
        self._machine = machine
        machine.lost_messages = lambda: self._server.counters
        self._server.start(
            loop,
            on_message=lambda payload, user: machine.targets(payload, now_ns(), user),
            on_request=lambda payload, user: machine.request(payload, now_ns(), user),
        )
        self._link.start(
            loop,
            on_bytes=lambda data: machine.board_bytes(data, now_ns()),
            on_link=lambda up, reason: machine.board_link(up, reason, now_ns()),
        )
        self._trackpad.start(
            loop,
            on_reports=self._reports,
            on_link=lambda up, reason: machine.trackpad_link(up, reason, now_ns(), model=self._trackpad.model),
        )
        self._on_timer()

    async def stop(self) -> None:
        """Quiet the plate, then close: clients, trackpad, and the board last."""
        if self._timer is not None:
            self._timer.cancel()
        if self._machine is not None:
            self._machine.stop(now_ns())
        await self._trackpad.close()
        await self._link.drained(QUIET_WITHIN_S)
        self._link.close()
        self._server.close()

    def _reports(self, batch: Sequence[RawReport]) -> None:
        self._let_publish()
        self.machine.reports(batch, now_ns())
        if self.machine.trackpad.needs_enable:
            self._trackpad.request_enable()

    def _on_timer(self) -> None:
        self._timer = self._loop.call_later(TIMER_NS * 1e-9, self._on_timer)
        self._let_publish()
        self.machine.timer(now_ns())
        self._server.sweep()

    def _let_publish(self) -> None:
        """No subscriber: no telemetry is built."""
        self.machine.publish = self._server.publish if self._server.has_subscribers else None


async def serve(daemon: Daemon, modes: ModeShapes) -> None:
    """Run `daemon` until SIGTERM or SIGINT, then leave a quiet plate."""
    loop = asyncio.get_running_loop()
    asked: asyncio.Future[signal.Signals] = loop.create_future()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, _answer, asked, number)
    try:
        daemon.start(loop, modes)
        _freeze_garbage()
        log.info("serving clients in %s", daemon.runtime_dir)
        log.info("%s: stopping, the plate is made quiet", (await asked).name)
    finally:
        await daemon.stop()


def _answer(asked: asyncio.Future[signal.Signals], number: signal.Signals) -> None:
    if not asked.done():
        asked.set_result(number)


def run(config: Config) -> None:
    """What `hapticd run` does, with the simulated rig beside it where the configuration asks for it."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until the loop takes it over: a started rig ends too
    runtime_dir = Path(config.client.runtime_dir) if config.client.runtime_dir else runtime_directory(os.environ)
    modes = load_modes(config)  # what is wrong with a file is said before anything is opened
    measured = calibration.load(Path(config.device.calibration_file), modes.M) if config.device.calibration_file else ()
    remote = _remote(config)
    with contextlib.ExitStack() as stack:
        rig_dir = _rig_directory(config, stack)
        board_port = str(rig_dir / "board") if config.device.port == SIMULATED else config.device.port
        daemon = Daemon(
            config,
            runtime_dir,
            board_port=board_port,
            trackpad=_trackpad(config, rig_dir),
            calibration=measured,
            remote=remote,
        )
        asyncio.run(serve(daemon, modes))


def _rig_directory(config: Config, stack: contextlib.ExitStack) -> Path:
    """Where the simulated rig is: one that runs already, or one of our own until `stack` unwinds."""
    if config.sim.rig_dir or SIMULATED not in (config.trackpad.source, config.device.port):
        return Path(config.sim.rig_dir)
    return stack.enter_context(RigProcess(config.sim.scenario, config.sim.seed)).directory


def load_modes(config: Config) -> ModeShapes:
    """The configured mode shapes; for the simulated plate its own cartography. Raises ModesError, ConfigError."""
    if config.plate.modes_file:
        modes = ModeShapes.load(config.plate.modes_file)
    else:
        modes = PlateTruth(PlateSettings()).cartography(config.sim.seed)
    if len(config.limits.w_limit_um) != modes.M:
        raise ConfigError(
            f"limits.w_limit_um: has {len(config.limits.w_limit_um)} limits for a plate of {modes.M} modes: "
            "give one for each mode."
        )
    return modes


def _remote(config: Config) -> Remote | None:
    """Where clients connect over TCP, if anywhere. Raises HapticdError where it would be without keys."""
    if not config.client.tcp:
        return None
    host, _, port = config.client.tcp.rpartition(":")
    return Remote(host, int(port), keys.load(Path(config.client.keys_dir)))


def _trackpad(config: Config, rig_dir: Path) -> TrackpadSource:
    if config.trackpad.source == "hid":
        return HidTrackpad(config.trackpad.model)
    if config.trackpad.source == "replay":
        return ReplayTrackpad(config.trackpad.replay_file)
    return SocketTrackpad(rig_dir / "trackpad", "mt2-usb")


def _freeze_garbage() -> None:
    """What is alive now lives as long as the daemon: the collector need not look at it again and again."""
    gc.collect()
    gc.freeze()


def now_ns() -> int:
    """The host's monotonic clock: the axis of all `t_..._ns`."""
    return time.monotonic_ns()
