"""A recording as tidy tables: one row for each observation, one column for each quantity, its unit in its name.

Every table begins with `t_s`, seconds since the recording's begin, and `t_ns`, the host's monotonic clock.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import numpy.typing as npt

from ...files.recording.reader import Recording
from ...files.recording.records import KINDS, LEDGER, Record

Row = tuple[Any, ...]
Column = npt.NDArray[Any]
TIME = ("t_s", "t_ns")
_STATUS = [name for name in KINDS["status"].names[1:] if name not in ("measured_um", "voltage_v")]
_NUMBERS, _WHOLES, _TRUTHS = np.float64, np.int64, np.bool_
_TEXTS = np.object_  # each as long as it is: one long message must not make all others as long

# Column names and their types, after those of TIME.
TABLES: dict[str, dict[str, type]] = {
    "reports": {"t_host_ns": _WHOLES, "data_hex": _TEXTS},
    "fingers": {
        "t_sample_ns": _WHOLES,
        "finger_id": _WHOLES,
        "contact_id": _WHOLES,
        "x_mm": _NUMBERS,
        "y_mm": _NUMBERS,
    },
    "predictions": {
        "t_plate_ns": _WHOLES,
        "finger": _TEXTS,
        "x_mm": _NUMBERS,
        "y_mm": _NUMBERS,
        "end_x_mm": _NUMBERS,
        "end_y_mm": _NUMBERS,
    },
    "targets": {"finger": _TEXTS, "target_um": _NUMBERS, "achieved_um": _NUMBERS},
    "references": {
        "t_knot_ns": _WHOLES,
        "knot": _WHOLES,
        "mode": _WHOLES,
        "reference_d_um": _NUMBERS,
        "reference_q_um": _NUMBERS,
    },
    "passes": {
        "age_ms": _NUMBERS,
        "horizon_ms": _NUMBERS,
        "state": _TEXTS,
        "is_limited": _TRUTHS,
        "fingers": _WHOLES,
        "knots": _WHOLES,
        "gate_reasons": _WHOLES,
    },
    "board": {name: _TEXTS if name == "state" else _TRUTHS if name.startswith("is_") else _WHOLES for name in _STATUS},
    "modes": {
        "mode": _WHOLES,
        "measured_d_um": _NUMBERS,
        "measured_q_um": _NUMBERS,
        "voltage_d_v": _NUMBERS,
        "voltage_q_v": _NUMBERS,
    },
    "ledger": dict.fromkeys(LEDGER, _WHOLES),
    "markers": {"client": _TEXTS, "text": _TEXTS},
    "messages": {"socket": _TEXTS, "user": _TEXTS, "message_json": _TEXTS},
    "links": {"device": _TEXTS, "is_up": _TRUTHS, "reason": _TEXTS},
    "truth": {
        "finger": _WHOLES,
        "x_mm": _NUMBERS,
        "y_mm": _NUMBERS,
        "target_um": _NUMBERS,
        "plate_d_um": _NUMBERS,
        "plate_q_um": _NUMBERS,
    },
    "truth_modes": {"mode": _WHOLES, "plate_d_um": _NUMBERS, "plate_q_um": _NUMBERS},
}


def tables(recording: Recording) -> dict[str, dict[str, Column]]:
    """All tables that have rows, each as columns by name. Raises RecordingError."""
    rows: dict[str, list[Row]] = {name: [] for name in TABLES}
    for record in recording.records():
        for name, row in _rows(record):
            rows[name].append((_seconds(record.t_ns - recording.header.t_start_ns), record.t_ns, *row))
    return {name: _columns(name, found) for name, found in rows.items() if found}


def _seconds(span_ns: int) -> float:
    return span_ns * 1e-9


def _columns(name: str, rows: list[Row]) -> dict[str, Column]:
    types = {"t_s": _NUMBERS, "t_ns": _WHOLES} | TABLES[name]
    columns = zip(*rows, strict=True)
    return {column: np.array(values, dtype=kind) for (column, kind), values in zip(types.items(), columns, strict=True)}


def _rows(record: Record) -> Iterator[tuple[str, Row]]:
    """The rows that one record adds, and to which tables."""
    values = record.fields[1:]
    match record.kind:
        case "reports":
            for t_host_ns, data in values[0]:
                yield "reports", (t_host_ns, data.hex())
        case "pass":
            yield from _pass_rows(record)
        case "status":
            *row, measured_um, voltage_v = values
            yield "board", tuple(row)
            for mode, (w_um, v_v) in enumerate(zip(measured_um, voltage_v, strict=False)):
                yield "modes", (mode, *w_um, *v_v)
        case "ledger":
            yield "ledger", tuple(values)
        case "marker":
            yield "markers", tuple(values)
        case "targets" | "request":
            payload, user = values
            yield "messages", ("control" if record.kind == "request" else "targets", user, _as_json(payload))
        case "board_link" | "trackpad_link":
            yield "links", (record.kind.removesuffix("_link"), values[0], values[1])
        case "truth":
            yield from _truth_rows(*values)


def _pass_rows(record: Record) -> Iterator[tuple[str, Row]]:
    t_ns, age_ns, horizon_ns, state, is_limited, fingers, points, t_apply_ns, reasons, knots = record.fields
    yield "passes", (age_ns * 1e-6, horizon_ns * 1e-6, state, is_limited, len(fingers), len(knots), reasons)
    for finger in fingers:
        yield "fingers", (t_ns - age_ns, *finger)
    for key, x_mm, y_mm, target_um, achieved_um, end_x_mm, end_y_mm in points:
        yield "predictions", (t_ns - age_ns + horizon_ns, str(key), x_mm, y_mm, end_x_mm, end_y_mm)
        yield "targets", (str(key), target_um, achieved_um)
    for number, (dt_ns, modal_um) in enumerate(knots):
        for mode, w_um in enumerate(modal_um):
            yield "references", ((t_apply_ns or 0) + dt_ns, number, mode, *w_um)


def _truth_rows(
    finger_mm: list[Any], target_um: list[Any], modal_um: list[Any], truth_um: list[Any]
) -> Iterator[tuple[str, Row]]:
    nothing = (np.nan, np.nan)
    for finger, (place, target, got) in enumerate(zip(finger_mm, target_um, truth_um, strict=False)):
        if place is not None:
            yield "truth", (finger, *place, np.nan if target is None else target, *(nothing if got is None else got))
    for mode, w_um in enumerate(modal_um):
        yield "truth_modes", (mode, *w_um)


def _as_json(payload: bytes) -> str:
    """A client's message as text; bytes within it, and what is no message, as hexadecimal."""
    try:
        message = msgpack.unpackb(payload, raw=False, strict_map_key=True, max_ext_len=0)
        return json.dumps(message, default=lambda value: value.hex() if isinstance(value, bytes) else str(value))
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return json.dumps(payload.hex())
