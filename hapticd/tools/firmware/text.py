"""Text and JSON forms of the board's messages."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import sys
from collections.abc import Sequence
from enum import Enum
from typing import Any

from ... import board_protocol as protocol
from ...board_protocol import BoardState
from ...board_values import (
    BoardController,
    BoardHello,
    BoardLog,
    BoardStatus,
    LogEntry,
    SweepPoint,
)
from ...design.resonance import Resonance


def show(line: str, *, is_all: bool) -> None:
    """Print a line at once. If its reader has gone, as by `| head`, raise BrokenPipeError where printing `is_all` that
    is wanted, else print nothing from now on."""
    try:
        print(line, flush=True)
    except BrokenPipeError:
        if is_all:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def plain(value: Any) -> Any:
    """Return a value for JSON: dataclasses and named tuples become maps, complex numbers pairs, enums their names."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    return [value.real, value.imag] if isinstance(value, complex) else value


def as_json(value: Any) -> str:
    """Return `plain(value)` as indented JSON."""
    return json.dumps(plain(value), indent=2)


def board(hello: BoardHello, status: BoardStatus, round_trip_ms: float) -> str:
    """Return the board's identity and status."""
    limits = ", ".join(f"{limit_um:g}" for limit_um in hello.w_limit_um)
    state = protocol.STATES[status.state.value]
    if status.state is BoardState.FAULT:
        state += f": {protocol.FAULTS.get(status.fault_code, f'code {status.fault_code}')}"
    rows = (
        (
            "firmware",
            f"{hello.firmware_version}, protocol {hello.protocol_version} ({hello.protocol_hash:08x}){_image(hello)}",
        ),
        ("boot", f"{hello.boot_id:08x}, {status.t_board_us / 1e6:.1f} s on its clock of 71.6 minutes"),
        ("state", state),
        ("modes", f"{hello.modes}, limits {limits} um and {hello.v_limit_v:g} V"),
        ("rates", f"control {hello.control_hz:g} Hz, dead-man {hello.deadman_ms} ms"),
        ("drive", drive(status.drive_hz, status.drive_hz - hello.drive_hz)),
        ("sync", "a pin rises with marked references" if hello.has_sync else "no output"),
        (
            "link",
            f"{round_trip_ms:.1f} ms round trip, {status.bad_frames} bad and {status.late_frames} late frames",
        ),
        ("trips", f"{status.deadman_trips} of the dead-man"),
    )
    return "\n".join(f"{name:<9} {text}" for name, text in rows)


def _image(hello: BoardHello) -> str:
    return f", image {hello.image_crc:08x}" if hello.image_crc else ""


def drive(drive_hz: float, moved_hz: float) -> str:
    """Return the drive, and how far it went after the plate."""
    return f"{drive_hz:.2f} Hz" + (f", {moved_hz:+.2f} Hz after the plate" if abs(moved_hz) >= 0.005 else "")


def controller(found: BoardController) -> str:
    """Return control law, gains and the model of each mode."""
    lines = [
        f"law       {found.law or 'unknown to this hapticd'}, bandwidth {found.bandwidth_1_s:g} 1/s, "
        f"integral time {1e3 * found.integral_time_s:g} ms"
    ]
    for k, model in enumerate(found.models):
        phase_deg = math.degrees(math.atan2(model.loop.imag, model.loop.real))
        offset_hz = model.detuning_rad_s / (2 * math.pi)
        lines.append(
            f"mode {k}    decay {model.decay_1_s:.1f} 1/s, {offset_hz:+.2f} Hz from the drive, "
            f"gain {model.gain_um_per_v_s:.4g} um/(V s), loop phase {phase_deg:+.1f} degrees"
        )
    return "\n".join(lines)


def log(found: BoardLog, boot_id: int) -> str:
    """Return the cause of the last reset and the logged events."""
    cause = protocol.RESET_CAUSES.get(found.reset_cause, f"code {found.reset_cause}")
    lines = [f"reset     {cause}", f"events    {found.events} logged"]
    return "\n".join(lines + [f"  {_entry(entry, boot_id)}" for entry in found.entries])


def _entry(entry: LogEntry, boot_id: int) -> str:
    boot = "this boot" if entry.boot_id == boot_id else f"boot {entry.boot_id:08x}"
    sentences = protocol.FAULTS | protocol.EVENTS | protocol.BOARD_EVENTS
    what = sentences.get(entry.code, f"code {entry.code}")
    mode = "" if entry.mode is None else f", mode {entry.mode}"
    value = "" if entry.value == 0.0 else f" ({entry.value:g})"
    return f"{boot}, at {entry.t_board_us / 1e6:.3f} s{mode}: {what}{value}"


def sweep_head(modes: int) -> str:
    """Return the table's header."""
    return "      Hz  " + "  ".join(f"  |W{k}| um   degrees" for k in range(modes))


def sweep_row(point: SweepPoint) -> str:
    """Return one line of the table: amplitude and phase of each mode against the voltage."""
    cells = [f"{abs(w):9.5f} {math.degrees(math.atan2(w.imag, w.real)):9.2f}" for w in point.measured_um]
    return f"{point.frequency_hz:9.2f} " + "  ".join(cells)


def resonance(mode: int, found: Resonance, points: Sequence[SweepPoint]) -> str:
    """Return the fitted resonance of a sweep."""
    driven = max(abs(point.measured_um[mode]) for point in points)
    others = [abs(w) for point in points for k, w in enumerate(point.measured_um) if k != mode]
    rows = (
        ("mode", f"{mode}, {len(points)} points"),
        ("resonance", f"{found.frequency_hz:.2f} Hz"),
        ("quality", f"{found.q_factor:.1f}"),
        ("gain", f"{found.gain_um_per_v_s:.4g} um/(V s)"),
        ("phase", f"{math.degrees(found.loop_phase_rad):+.2f} degrees of the loop"),
        ("residual", f"{100 * found.residual_frac:.2f} % of the largest response"),
        ("others", f"{100 * max(others, default=0.0) / driven:.1f} % of the response in other modes, at most"),
    )
    return "\n".join(f"{name:<9} {text}" for name, text in rows)
