"""Calibration file: the swept modes of a plate as TOML that a person can read and correct.

`hapticd calibrate resonance` writes it; the service reads `device.calibration_file` and sends it to the board.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .. import board_protocol as protocol
from ..board_values import BoardCalibration, ModeCalibration, is_within
from ..errors import ConfigError
from ..formats.toml_file import read_table, shown
from ..regular_file import opened

# Key: lower and upper bound.
KEYS = {
    "frequency_hz": (1000.0, 1e6),
    "q_factor": (1.0, 1e5),
    "gain_um_per_v_s": (0.001, 1e4),
    "loop_phase_deg": (-360.0, 360.0),
}
# Optional key: bounds of each wire's number, or of a complex one's magnitude.
WIRES = {
    "drive": protocol.SET_WIRING_BOUNDS["drive"],
    "sense": protocol.SET_WIRING_BOUNDS["sense"],
    "feedthrough_um_per_v": protocol.SET_WIRING_BOUNDS["feedthrough"],
}
DRIVE_KEY, DRIVE_HZ = "drive_hz", KEYS["frequency_hz"]
HEADER = """\
# Modes and wires of the plate, measured by `hapticd calibrate resonance`. The plate moves by gain_um_per_v_s for each
# volt and second; loop_phase_deg is what amplifier, electrodes and sensor add to the loop. drive is what each amplifier
# gives per volt of the mode, sense each sensor's weight in its amplitude, feedthrough_um_per_v what a volt of each
# amplifier adds to that without moving it; [real, imaginary]. drive_hz, if it is there, is set on the board.
"""


def load(path: Path, modes: int) -> BoardCalibration:
    """Read the calibrated modes, at most one for each of `modes`, and the drive. Raises ConfigError."""
    table = read_table(path, "check device.calibration_file")
    drive_hz = _bounded(table.pop(DRIVE_KEY), DRIVE_HZ, f"{path}: {DRIVE_KEY}") if DRIVE_KEY in table else None
    entries = table.pop("mode", None)
    if table or not isinstance(entries, list):
        raise ConfigError(
            f"{path}: must hold [[mode]] tables, drive_hz and nothing else: measure with `hapticd calibrate resonance`."
        )
    found = [_mode(entry, f"{path}: [[mode]] {place}", modes) for place, entry in enumerate(entries, 1)]
    for place, measured in enumerate(found, 1):
        if not 0 <= measured.mode < modes:
            raise ConfigError(f"{path}: [[mode]] {place}: mode {measured.mode} is not one of the plate's {modes}.")
        if measured.mode in [earlier.mode for earlier in found[: place - 1]]:
            raise ConfigError(f"{path}: [[mode]] {place}: mode {measured.mode} is listed twice: delete one.")
    return BoardCalibration(tuple(found), drive_hz)


def _bounded(value: Any, bounds: tuple[float, float], where: str) -> float:
    low, high = bounds
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ConfigError(f"{where}: {shown(value)} is out of bounds: it must be {low:g} .. {high:g}.")
    return float(value)


def save(path: Path, calibration: BoardCalibration) -> None:
    """Overwrite the file, modes in order. Raises HapticdError."""
    drive = "" if calibration.drive_hz is None else f"\n{DRIVE_KEY} = {calibration.drive_hz:.3f}\n"
    modes = sorted(calibration.modes, key=lambda measured: measured.mode)
    with opened(path) as file:
        file.write((HEADER + drive + "".join(_text(measured) for measured in modes)).encode())


def _text(measured: ModeCalibration) -> str:
    return (
        f"\n[[mode]]\nmode = {measured.mode}\nfrequency_hz = {measured.frequency_hz:.3f}\n"
        f"q_factor = {measured.q_factor:.2f}\ngain_um_per_v_s = {measured.gain_um_per_v_s:.5g}\n"
        f"loop_phase_deg = {math.degrees(measured.loop_phase_rad):.2f}\n"
    ) + "".join(f"{key} = [{_listed(getattr(measured, key))}]\n" for key in WIRES if getattr(measured, key))


def _listed(wires: Sequence[complex]) -> str:
    pairs = (f"[{wire.real:.6g}, {wire.imag:.6g}]" if isinstance(wire, complex) else f"{wire:.6g}" for wire in wires)
    return ", ".join(pairs)


def _mode(entry: Any, where: str, modes: int) -> ModeCalibration:
    if not isinstance(entry, dict):
        raise ConfigError(f"{where}: must be a table: write [[mode]] and its keys below.")
    unknown = set(entry) - {"mode", *KEYS, *WIRES}
    missing = {"mode", *KEYS} - set(entry)
    if unknown or missing:
        wrong = f"unknown key {min(unknown)}" if unknown else f"{min(missing)} is missing"
        raise ConfigError(f"{where}: {wrong}: the keys are mode, {', '.join((*KEYS, *WIRES))}.")
    mode = entry["mode"]
    if isinstance(mode, bool) or not isinstance(mode, int):
        raise ConfigError(f"{where}.mode: must be a whole number, 0 for the first mode, not {shown(mode)}.")
    frequency_hz, q_factor, gain_um_per_v_s, loop_phase_deg = (
        _bounded(entry[key], bounds, f"{where}.{key}") for key, bounds in KEYS.items()
    )
    if not is_within(math.pi * frequency_hz / q_factor, protocol.SET_MODEL_BOUNDS["decay_1_s"]):
        raise ConfigError(f"{where}.q_factor: {q_factor:g} does not describe a resonance: measure again.")
    return ModeCalibration(
        mode,
        frequency_hz,
        q_factor,
        gain_um_per_v_s,
        math.radians(loop_phase_deg),
        drive=tuple(wire.real for wire in _wires(entry, "drive", where, modes)),
        sense=_wires(entry, "sense", where, modes),
        feedthrough_um_per_v=_wires(entry, "feedthrough_um_per_v", where, modes),
    )


def _wires(entry: dict[str, Any], key: str, where: str, modes: int) -> tuple[complex, ...]:
    """Return the numbers of all wires, real ones or pairs; none if the key is missing."""
    wires, is_real = entry.get(key, []), key == "drive"
    if not isinstance(wires, list) or len(wires) not in (0, modes):
        raise ConfigError(f"{where}.{key}: {shown(wires)} is not a list of {modes}: give a number for each wire.")
    found = []
    for wire in wires:
        parts = [wire] if is_real else wire
        is_number = isinstance(parts, list) and all(type(part) in (int, float) for part in parts)
        if not is_number or len(parts) != (1 if is_real else 2):
            kind = "a number" if is_real else "[real, imaginary]"
            raise ConfigError(f"{where}.{key}: {shown(wire)} is out of place: give {kind} for each wire.")
        value = complex(*parts)
        if not is_within(value.real if is_real else abs(value), WIRES[key]):
            low, high = WIRES[key]
            raise ConfigError(f"{where}.{key}: {shown(wire)} is out of bounds: it must be {low:g} .. {high:g}.")
        found.append(value)
    return tuple(found)
