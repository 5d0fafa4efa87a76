"""`hapticd doctor`: what the service needs, one by one; each line passes, warns or fails, and says what mends it.

Nothing is opened for longer than it takes to look, and nothing is sent to the board.
"""

from __future__ import annotations

import fcntl
import importlib.util
import os
import resource
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from . import config as configuration
from .config import SIMULATED, Config
from .errors import HapticdError
from .io import keys
from .io.runtime_dir import endpoint_path, runtime_directory
from .io.trackpad import find_pads, load_hid

PASS, WARN, FAIL = "pass", "warn", "FAIL"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report; `remedy` is what to do, empty where there is nothing to do."""

    verdict: str
    what: str
    remedy: str = ""


def examine(config_path: Path | None) -> int:
    """Print the report. Returns 1 if something fails, else 0."""
    failed = False
    for finding in _findings(config_path):
        print(f"{finding.verdict}  {finding.what}")
        if finding.remedy:
            print(f"      -> {finding.remedy}")
        failed |= finding.verdict == FAIL
    return int(failed)


def _findings(config_path: Path | None) -> Iterator[Finding]:
    try:
        config = configuration.load(config_path) if config_path is not None else Config()
    except HapticdError as error:
        yield Finding(FAIL, f"configuration: {error}", "mend the file; `hapticd run --print-config` shows every key")
        return
    yield Finding(PASS, f"configuration: {config_path or 'the built-in one'} is valid")
    checks: tuple[Callable[[Config], Finding], ...] = (
        _modes,
        _simulation,
        _trackpad,
        _board,
        _daemon,
        _keys,
        _client,
        _rights,
    )
    for check in checks:
        yield check(config)


def _modes(config: Config) -> Finding:
    from .service import load_modes

    try:
        modes = load_modes(config)
    except HapticdError as error:
        return Finding(FAIL, f"mode shapes: {error}")
    return Finding(PASS, f"mode shapes: {modes.M} modes from {config.plate.modes_file or 'the simulated cartography'}")


def _simulation(_: Config) -> Finding:
    if importlib.util.find_spec("hapticd.sim._firmware") is None:
        return Finding(WARN, "simulated board: its firmware is not built", "install a C compiler and hapticd again")
    return Finding(PASS, "simulated board: its firmware is built")


def _trackpad(config: Config) -> Finding:
    if config.trackpad.source != "hid":
        return Finding(PASS, f"trackpad: {config.trackpad.source} asked for")
    try:
        pads = list(find_pads(load_hid(), config.trackpad.model))
    except (HapticdError, OSError) as error:
        return Finding(FAIL, f"trackpad: {error}")
    if not pads:
        return Finding(FAIL, "trackpad: none is connected", "plug it in, or pair it over Bluetooth and wake it")
    pad, path = pads[0]
    node = os.fsdecode(path)
    if node.startswith("/dev/") and not os.access(node, os.R_OK | os.W_OK):
        return Finding(
            FAIL, f"trackpad: {node} is not yours to open", "install the udev rule in systemd/, replug the pad"
        )
    return Finding(PASS, f"trackpad: {pad.model} at {node}")


def _board(config: Config) -> Finding:
    port = config.device.port
    if port == SIMULATED:
        return Finding(PASS, "board: simulated")
    if not Path(port).exists():
        return Finding(
            FAIL, f"board: there is no {port}", "plug the board in; `ls /dev/ttyACM* /dev/ttyUSB*` shows ports"
        )
    if not os.access(port, os.R_OK | os.W_OK):
        return Finding(FAIL, f"board: {port} is not yours to open", "join its group: `ls -l` on it names the group")
    return Finding(PASS, f"board: {port} can be opened")


def _daemon(config: Config) -> Finding:
    directory = Path(config.client.runtime_dir) if config.client.runtime_dir else runtime_directory(os.environ)
    try:
        control = endpoint_path(directory, "control")
    except HapticdError as error:
        return Finding(FAIL, f"endpoints: {error}")
    if not (control.is_socket() and _is_locked(directory / "lock")):
        return Finding(
            WARN, f"daemon: none serves {directory}", "start it: `hapticd run`, or `systemctl start hapticd`"
        )
    if not os.access(control, os.R_OK | os.W_OK):
        return Finding(FAIL, f"daemon: {control} is not yours to connect to", "join the daemon's group")
    return Finding(PASS, f"daemon: endpoints in {directory}")


def _is_locked(path: Path) -> bool:
    """A daemon lives: it holds its lock for as long as it does, while its sockets may outlive it."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _keys(config: Config) -> Finding:
    if not config.client.tcp:
        return Finding(PASS, "TCP: not asked for, clients are on this machine")
    try:
        ring = keys.load(Path(config.client.keys_dir))
    except HapticdError as error:
        return Finding(FAIL, f"TCP: {error}")
    return Finding(PASS, f"TCP: {config.client.tcp}, for {', '.join(ring.clients.values())}")


def _client(_: Config) -> Finding:
    if importlib.util.find_spec("hapticd_client") is None:
        return Finding(WARN, "client library: not installed here", "`pip install clients/python`")
    return Finding(PASS, "client library: installed")


def _rights(config: Config) -> Finding:
    wanted = config.realtime.fifo_priority
    if wanted == 0:
        return Finding(PASS, "real time: not asked for")
    priority, _hard = resource.getrlimit(resource.RLIMIT_RTPRIO)
    if priority < wanted and os.geteuid() != 0:
        return Finding(
            WARN,
            f"real time: this user may ask for priority {priority}, not {wanted}",
            "run it as the service: its unit in systemd/ grants 20",
        )
    return Finding(PASS, f"real time: priority {wanted} may be asked for")
