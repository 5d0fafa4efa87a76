"""`hapticd run`: a daemon from a configuration, with the simulated rig if the configuration asks for it.

What can be wrong is found before anything is opened: files are read and judged first. At SIGHUP another process does
that, for a second thread in this one would keep the loop from its work, and the board waits 50 ms. Only once it has
found all sound is the plate left quiet, and what runs replaced.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..board_values import UNCALIBRATED, BoardCalibration
from ..config.loader import load, on_plate, with_uncertainty
from ..config.sections import SIMULATED, Config, SimConfig
from ..core.plate.mode_shapes import ModeShapes, ParasiticModes
from ..daemon.daemon import Daemon
from ..daemon.lifecycle import serve
from ..daemon.settings import warm_up
from ..errors import ConfigError, HapticdError, ModesError, TrackpadError
from ..files import calibration
from ..formats import npz
from ..formats.mode_map import MAX_BYTES, require_usable
from ..io.clients import gate, keys
from ..io.clients.server import runtime_directory
from ..io.clients.sockets import Remote
from ..io.devices.socket_trackpad import SocketTrackpad
from ..io.devices.trackpad_source import TrackpadSource
from ..io.host.limits import require_descriptors
from ..io.host.systemd import Notifier
from ..regular_file import read_bounded
from ..sim.fingers.trajectories import read_repeated
from ..sim.plate.glasses import driven_modes, find_glass
from ..sim.plate.wirings import wiring
from ..sim.rig.process import MODES_FILE, PARASITIC_MODES_FILE, PLATE_FILE, RigProcess
from . import pads

log = logging.getLogger("hapticd")

GATES = 2  # of clients, and of recorders
OWN_DESCRIPTORS = 128  # of listeners, devices, files, pipes, libzmq itself: on the simulated plate there are 40
MAX_DESCRIPTORS = GATES * gate.MAX_DESCRIPTORS + OWN_DESCRIPTORS
WATCHDOG_EVERY_S = 0.2  # watchdog period while a configuration is prepared
CHECK_WITHIN_S = 30.0
SELF_TEST = (sys.executable, "-P", "-m", "hapticd", "firmware", "selftest")


@dataclass(frozen=True, slots=True)
class Prepared:
    """A configuration with all files that it names, read and checked; only the simulated rig is running."""

    config: Config
    modes: ModeShapes
    parasitic_modes: ParasiticModes | None
    calibration: BoardCalibration
    trackpad: TrackpadSource
    remote: Remote | None
    board_port: str
    runtime_dir: Path

    def daemon(self, notifier: Notifier | None = None) -> Daemon:
        """Return a daemon for it, not yet started."""
        return Daemon(
            self.config,
            self.runtime_dir,
            board_port=self.board_port,
            trackpad=self.trackpad,
            calibration=self.calibration,
            parasitic_modes=self.parasitic_modes,
            self_test=SELF_TEST,
            notifier=notifier,
            remote=self.remote,
        )


class ConfigLoader:
    """Prepares configurations, and owns the simulated rigs that they need until it is closed."""

    def __init__(self) -> None:
        self._rigs: dict[SimConfig, RigProcess] = {}

    def __enter__(self) -> ConfigLoader:
        """Raises HapticdError where this process may not open or start what the clients can make necessary."""
        require_descriptors(MAX_DESCRIPTORS)
        return self

    def __exit__(self, *_: object) -> None:
        for rig in self._rigs.values():
            rig.close()

    def watch(self, on_end: Callable[[str], None]) -> None:
        """Call `on_end` with a sentence when a rig ends that should run."""
        for rig in self._rigs.values():
            rig.watch(on_end)

    def prepare(self, config: Config) -> Prepared:
        """Read the files that the configuration names. Raises HapticdError in one sentence."""
        rig_dir = self._rig_directory(config)
        if rig_dir != Path():
            config = _on_rig(config, rig_dir)
        modes = load_modes(config, rig_dir)
        warm_up(config)
        return Prepared(
            config,
            modes,
            *_read(config, modes.M, rig_dir),
            str(rig_dir / "board") if config.device.port == SIMULATED else config.device.port,
            runtime_directory(os.environ),
        )

    def _rig_directory(self, config: Config) -> Path:
        """Return the simulated rig's directory: of one that runs already, or a new one; "." if none is needed."""
        if not _needs_rig(config):
            return Path(config.sim.rig_dir)
        sim = config.sim
        if sim not in self._rigs:
            self._rigs[sim] = RigProcess(
                *(SimConfig().scenario if sim.fingers_file else sim.scenario, sim.seed),
                fingers=sim.fingers_file,
                plate=sim.plate,
                modes=_driven_modes(sim),
                wiring=sim.wiring,
            )
        return self._rigs[sim].directory


def check(config: Config) -> None:
    """Check a configuration (`hapticd run --check`). Raises HapticdError in one sentence.

    No simulated plate is built, which takes a second: what counts is how many modes it drives.
    """
    with ConfigLoader() as config_loader:
        if not _needs_rig(config):
            config_loader.prepare(config)
            return
    size_mm, modes = find_glass(config.sim.plate).size_mm, _driven_modes(config.sim)
    if config.sim.fingers_file:
        read_repeated(Path(config.sim.fingers_file), size_mm)
    if config.plate.modes_file:
        modes = load_modes(config).M
    elif config.device.port == SIMULATED:
        config = on_plate(config, size_mm, (0.0,) * modes)
    _check_limits(config, modes)
    _read(config, modes, Path())


def run(config: Config, reread: Callable[[], Config] | None = None, judge: Sequence[str] = ()) -> None:
    """Run the service until SIGTERM or SIGINT. At SIGHUP the command `judge` checks the configuration file, then
    `reread` returns it."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until the loop handles it: a started rig ends too
    signal.signal(signal.SIGHUP, lambda *_: None)  # until then there is nothing to reload
    with ConfigLoader() as config_loader, contextlib.closing(Notifier()) as notifier:
        asyncio.run(_serve(config_loader, config_loader.prepare(config), notifier, reread, judge))


async def _serve(
    config_loader: ConfigLoader,
    prepared: Prepared,
    notifier: Notifier,
    reread: Callable[[], Config] | None,
    judge: Sequence[str] = (),
) -> None:
    async def read_again() -> Config:
        assert reread is not None
        await _check_elsewhere(judge)
        return reread()

    while True:
        requested = await serve(
            prepared.daemon(notifier), prepared.modes, read_again if reread else None, config_loader.watch
        )
        if requested is None:
            break
        prepared = await _prepared(config_loader, requested, prepared.config, notifier)
    notifier.notify(stopping=1)


async def _check_elsewhere(command: Sequence[str]) -> None:
    """Check the new configuration in another process. Raises HapticdError with its message."""
    if not command:
        return
    judge = await asyncio.create_subprocess_exec(*command, stderr=asyncio.subprocess.PIPE)
    try:
        _, output = await asyncio.wait_for(judge.communicate(), CHECK_WITHIN_S)
    except TimeoutError:
        raise HapticdError(f"Configuration check timed out after {CHECK_WITHIN_S:g} s.") from None
    finally:
        if judge.returncode is None:
            judge.kill()
            await judge.wait()
    if judge.returncode != 0:
        lines = output.decode(errors="replace").strip().splitlines()
        reason = lines[-1].removeprefix("hapticd: ") if lines else "Configuration check failed without a message."
        raise HapticdError(reason)


async def _prepared(config_loader: ConfigLoader, requested: Config, before: Config, notifier: Notifier) -> Prepared:
    """Prepare the new configuration, or the previous one if a file vanished since the check."""
    preparing = asyncio.create_task(asyncio.to_thread(config_loader.prepare, requested))
    while not (await asyncio.wait({preparing}, timeout=WATCHDOG_EVERY_S))[0]:
        notifier.notify(watchdog=1)
    try:
        return preparing.result()
    except HapticdError as error:
        log.error("SIGHUP: %s The present configuration stays.", error)
        return config_loader.prepare(before)


def load_modes(config: Config, rig_dir: Path | None = None) -> ModeShapes:
    """Return the configured mode map; for the simulated plate the rig's, computed here if no rig has written one.

    Raises ConfigError; ModesError for the rig's own map.
    """
    if config.plate.modes_file:
        modes = _measured(config)
    elif rig_dir is not None and (rig_dir / MODES_FILE).is_file():
        modes = ModeShapes.load(rig_dir / MODES_FILE)
    else:
        from ..sim.plate.ground_truth import (  # imported late: half the memory of a daemon without it
            GroundTruth,
            PlateSettings,
        )

        plate = PlateSettings.of(config.sim.plate, _driven_modes(config.sim))
        modes = GroundTruth(plate).measured_mode_map(config.sim.seed)
    _check_limits(config, modes.M)
    return modes


def _check_limits(config: Config, modes: int) -> None:
    limits = len(config.limits.w_limit_um)
    if limits != modes:
        raise ConfigError(
            f"limits.w_limit_um: has {limits} limits for a plate of {modes} modes: give one for each mode."
        )


def _needs_rig(config: Config) -> bool:
    """Whether a simulated device is configured that does not run yet."""
    return not config.sim.rig_dir and SIMULATED in (config.trackpad.source, config.device.port)


def _read(
    config: Config, modes: int, rig_dir: Path
) -> tuple[ParasiticModes | None, BoardCalibration, TrackpadSource, Remote | None]:
    """Read the other files that the configuration of a plate of so many modes names. Raises HapticdError."""
    measured = config.device.calibration_file
    return (
        _parasitic_modes(rig_dir) if config.device.port == SIMULATED else None,
        calibration.load(Path(measured), modes) if measured else UNCALIBRATED,
        _trackpad(config, rig_dir),
        _remote(config),
    )


def _parasitic_modes(rig_dir: Path) -> ParasiticModes | None:
    """Return the parasitic modes of the rig's plate; no calibration step measures those of a real one."""
    file = rig_dir / PARASITIC_MODES_FILE
    if not file.is_file():
        return None
    numbers = npz.arrays_of(read_bounded(file, MAX_BYTES), (("decay_1_s", "detuning_rad_s"),), MAX_BYTES)
    return ParasiticModes(ModeShapes.load(file), *(array.tolist() for array in numbers.values()))


def _measured(config: Config) -> ModeShapes:
    """Return the map that the configuration names. Raises ConfigError."""
    path = config.plate.modes_file
    try:
        modes = ModeShapes.load(path)
    except ModesError as error:
        raise ConfigError(f"plate.modes_file: {error}") from None
    try:
        require_usable((modes.x_mm, modes.y_mm, modes.shapes), config.plate.size_mm)
    except ModesError as error:
        raise ConfigError(f"plate.modes_file: {path}: {error}") from None
    return modes


def _driven_modes(sim: SimConfig) -> int:
    """Return the number of driven modes of the simulated plate. Raises ConfigError."""
    try:
        modes = driven_modes(sim.plate, sim.modes)
    except ValueError as error:
        raise ConfigError(f"sim.modes: {error}") from None
    try:
        wiring(sim.wiring, modes)
    except ValueError as error:
        raise ConfigError(f"sim.wiring: {error}") from None
    return modes


def _on_rig(config: Config, rig_dir: Path) -> Config:
    """Add the size and limits of the rig's plate, unless the configuration names a map of its own."""
    config = replace(config, sim=replace(config.sim, rig_dir=str(rig_dir)))
    file = rig_dir / PLATE_FILE
    if config.device.port != SIMULATED or not file.is_file():
        return config
    described = load(file)
    config = with_uncertainty(config, described.uncertainty)
    if config.plate.modes_file:
        return config
    return on_plate(config, described.plate.size_mm, described.limits.w_limit_um)


def _trackpad(config: Config, rig_dir: Path) -> TrackpadSource:
    if config.trackpad.source in pads.SOURCES:
        return pads.connected(config.trackpad)
    if config.trackpad.source == "replay":
        from ..io.devices.replay import ReplayTrackpad

        try:
            return ReplayTrackpad(config.trackpad.device, config.trackpad.size_mm)
        except TrackpadError as error:
            raise ConfigError(f"trackpad.device: {error}") from None
    return SocketTrackpad(rig_dir / "trackpad")


def _remote(config: Config) -> Remote | None:
    """Return where clients connect over TCP, if anywhere. Raises HapticdError if keys are missing."""
    if not config.client.tcp:
        return None
    host, _, port = config.client.tcp.rpartition(":")
    return Remote(host, int(port), keys.load(Path(config.client.keys_dir)))
