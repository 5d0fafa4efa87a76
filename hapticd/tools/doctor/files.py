"""The files that the configuration names: mode shapes, calibration, keys, and room for recordings."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ...errors import HapticdError
from ...files import calibration
from ...io.clients import keys
from .finding import FAIL, PASS, WARN, Finding, Patient

SIMULATED_MODES = 2


def modes(patient: Patient) -> Finding:
    """The map of the plate. That of the simulated one is computed at its start, which takes seconds: not here."""
    path, limits = patient.config.plate.modes_file, len(patient.config.limits.w_limit_um)
    if not path and limits == SIMULATED_MODES:
        return Finding(PASS, "mode shapes", "the simulated plate makes its own")
    if not path:
        said = f"limits.w_limit_um has {limits} limits, the simulated plate {SIMULATED_MODES} modes"
        return Finding(FAIL, "mode shapes", said, "give one limit for each mode, or plate.modes_file")
    from ...daemon.service import load_modes

    try:
        found = load_modes(patient.config)
    except HapticdError as error:
        return Finding(FAIL, "mode shapes", str(error), "measure again: hapticd calibrate modes --help")
    return Finding(PASS, "mode shapes", f"{found.M} modes from {path}")


def calibrated(patient: Patient) -> Finding:
    """What the board is told of the modes."""
    config = patient.config
    path = config.device.calibration_file
    if not path:
        if not patient.has_board:
            return Finding(PASS, "calibration", "the simulated board needs none")
        return Finding(
            WARN,
            "calibration",
            "none: the board drives your plate by the reference plate's figures",
            f"hapticd calibrate resonance --port {config.device.port} --out DIR, and device.calibration_file in the "
            "configuration",
        )
    try:
        found = calibration.load(Path(path), len(config.limits.w_limit_um))
    except HapticdError as error:
        return Finding(FAIL, "calibration", str(error), "measure again: hapticd calibrate resonance --help")
    missing = len(config.limits.w_limit_um) - len(found)
    if missing > 0:
        said = f"{path} knows {len(found)} of {len(config.limits.w_limit_um)} modes"
        return Finding(WARN, "calibration", said, f"hapticd firmware sweep --mode N --save {path}")
    hz = ", ".join(f"{one.frequency_hz:.1f}" for one in found)
    return Finding(PASS, "calibration", f"{path}: modes at {hz} Hz")


def key_ring(patient: Patient) -> Finding:
    """Who is served over TCP."""
    config = patient.config
    if not config.client.tcp:
        return Finding(PASS, "TCP", "not asked for, clients are on this machine")
    try:
        ring = keys.load(Path(config.client.keys_dir))
    except HapticdError as error:
        return Finding(FAIL, "TCP", str(error), f"hapticd keys make {config.client.keys_dir or 'DIR'}")
    return Finding(PASS, "TCP", f"{config.client.tcp}, for {', '.join(ring.clients.values())}")


def recordings(patient: Patient) -> Finding:
    """Room for what the configuration has written down."""
    record = patient.config.record
    if not record.file:
        return Finding(PASS, "recordings", "not asked for")
    folder = Path(record.file).absolute().parent
    try:
        free_mb = shutil.disk_usage(folder).free / 1e6
    except FileNotFoundError:
        return Finding(FAIL, "recordings", f"there is no folder {folder}", f"mkdir -p {folder}")
    except OSError as error:
        return Finding(WARN, "recordings", f"{folder} cannot be looked into ({error.strerror})", f"ls -ld {folder}")
    if patient.status is None and not os.access(folder, os.W_OK | os.X_OK):
        return Finding(
            WARN, "recordings", f"{folder} is not this user's to write to", f"chown hapticd: {folder}, for the service"
        )
    wanted_mb = record.max_mb * record.max_files
    said = f"{free_mb / 1e3:.1f} GB free in {folder}, of one start at most {wanted_mb / 1e3:.1f} GB are kept"
    if free_mb < wanted_mb:
        return Finding(WARN, "recordings", said, "make room, or lower record.max_mb and record.max_files")
    return Finding(PASS, "recordings", said)
