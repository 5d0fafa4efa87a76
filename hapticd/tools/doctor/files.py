"""Checks of the configured files: mode shapes, calibration, keys, and space for recordings."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ...config.sections import SIMULATED, DeviceConfig, LimitsConfig
from ...daemon.board_gateway import MOVED, UNKNOWN, UNSAFE
from ...daemon.recorder import MOST_FILES
from ...errors import HapticdError
from ...files import calibration
from ...io.clients import keys
from ...sim.plate.glasses import driven_modes
from .finding import FAIL, PASS, WARN, CheckResult, System


def modes(system: System) -> CheckResult:
    """Check the mode map. That of the simulated plate is computed at its start, which takes seconds: not here."""
    path, limits_um, sim = system.config.plate.modes_file, system.config.limits.w_limit_um, system.config.sim
    if not path:
        try:
            simulated = driven_modes(sim.plate, sim.modes)
        except ValueError as error:
            return CheckResult(FAIL, f"sim.modes: {error}", "set sim.modes to 0 for the plate's own")
        if len(limits_um) == simulated or limits_um == LimitsConfig().w_limit_um:
            return CheckResult(PASS, "computed for the simulated plate")
        text = f"limits.w_limit_um has {len(limits_um)} limits, the simulated plate {simulated} modes"
        return CheckResult(FAIL, text, "give one limit for each mode, or plate.modes_file")
    from ..service import load_modes

    try:
        found = load_modes(system.config)
    except HapticdError as error:
        return CheckResult(FAIL, str(error), "measure again: hapticd calibrate modes --help")
    return CheckResult(PASS, f"{found.M} modes from {path}")


def calibrated(system: System) -> CheckResult:
    """Check the calibration of the modes that is sent to the board, and what the daemon's self-test found of it."""
    config = system.config
    outcome, tested = (system.reported("board", "self_test", name) for name in ("outcome", "text"))
    if outcome in (MOVED, UNSAFE, UNKNOWN):
        verdict = FAIL if outcome == UNSAFE else WARN
        return CheckResult(verdict, f"self-test: {tested}", _selftest_command(config.device))
    path = config.device.calibration_file
    if not path:
        if not system.has_board:
            return CheckResult(PASS, "not needed by the simulated board")
        return CheckResult(
            WARN,
            "none: the board drives your plate by the reference plate's figures",
            f"hapticd calibrate resonance --port {config.device.port} --out DIR, and device.calibration_file in the "
            "configuration",
        )
    try:
        found = calibration.load(Path(path), len(config.limits.w_limit_um))
    except HapticdError as error:
        return CheckResult(FAIL, str(error), "measure again: hapticd calibrate resonance --help")
    missing = len(config.limits.w_limit_um) - len(found.modes)
    if missing > 0:
        text = f"{path} has {len(found.modes)} of {len(config.limits.w_limit_um)} modes"
        return CheckResult(WARN, text, "measure again: hapticd calibrate resonance --help")
    hz = ", ".join(f"{one.frequency_hz:.1f}" for one in found.modes)
    drive = "" if found.drive_hz is None else f", a drive of {found.drive_hz:.1f} Hz"
    test = f"; self-test: {tested}" if tested else ""
    return CheckResult(PASS, f"{path}: modes at {hz} Hz{drive}{test}")


def _selftest_command(device: DeviceConfig) -> str:
    port = "--sim" if device.port == SIMULATED else f"--port {device.port}"
    known = f" --calibration {device.calibration_file}" if device.calibration_file else ""
    return f"systemctl stop hapticd, then hapticd firmware selftest {port}{known}"


def key_ring(system: System) -> CheckResult:
    """Check the keys of clients over TCP."""
    config = system.config
    if not config.client.tcp:
        return CheckResult(PASS, "not configured: clients are local")
    try:
        ring = keys.load(Path(config.client.keys_dir))
    except HapticdError as error:
        return CheckResult(FAIL, str(error), f"hapticd service keys make {config.client.keys_dir or 'DIR'}")
    return CheckResult(PASS, f"{config.client.tcp}, for {', '.join(ring.clients.values())}")


def recordings(system: System) -> CheckResult:
    """Check folder and space for recordings."""
    record = system.config.record
    if not record.file:
        return CheckResult(PASS, "not configured")
    folder = Path(record.file).absolute().parent
    try:
        free_mb = shutil.disk_usage(folder).free / 1e6
    except FileNotFoundError:
        return CheckResult(FAIL, f"folder {folder} does not exist", f"mkdir -p {folder}")
    except OSError as error:
        return CheckResult(WARN, f"{folder} cannot be read ({error.strerror})", f"ls -ld {folder}")
    if system.status is None and not os.access(folder, os.W_OK | os.X_OK):
        return CheckResult(WARN, f"{folder} is not writable by this user", f"chown hapticd: {folder}, for the service")
    needed_mb = record.max_mb * MOST_FILES
    text = f"{free_mb / 1e3:.1f} GB free in {folder}, recordings take up to {needed_mb / 1e3:.1f} GB"
    if free_mb < needed_mb:
        return CheckResult(WARN, text, "free disk space, or lower record.max_mb")
    return CheckResult(PASS, text)
