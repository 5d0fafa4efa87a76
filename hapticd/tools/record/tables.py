"""A recording as tidy tables: one row for each observation, one column for each quantity, with its unit in its name.

Every table begins with `t_s`, seconds since the recording's start, and `t_ns`, the host's monotonic clock.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import numpy.typing as npt

from ...files.recording.kinds import BOOL, KINDS, PERCEIVED, TEXT, WHOLE, Fields, Record, key_of
from ...files.recording.mcap_reader import Recording
from ...values import LedgerLine

_Row = tuple[Any, ...]
Column = npt.NDArray[Any]
_STATUS = {name: form for name, form in KINDS["status"].form.items() if isinstance(form, str)}
_NUMBERS, _WHOLES, _TRUTHS = np.float64, np.int64, np.bool_
_TRUE = ("x_mm", "y_mm", "target_um", "plate_d_um", "plate_q_um")
_PRESSED = ("pressure_frac", "major_mm", "minor_mm", "angle_rad")  # by the pad; of earlier recordings in part
_TEXTS = np.object_  # of any length: one long message must not make all others as long


def _wholes(*names: str) -> dict[str, type]:
    return dict.fromkeys(names, _WHOLES)


def _numbers(*names: str) -> dict[str, type]:
    return dict.fromkeys(names, _NUMBERS)


def _texts(*names: str) -> dict[str, type]:
    return dict.fromkeys(names, _TEXTS)


# Column names and their types, after `t_s` and `t_ns`.
TABLES: dict[str, dict[str, type]] = {
    "reports": _wholes("t_host_ns") | _texts("data_hex"),
    "fingers": _wholes("t_sample_ns", "finger_id", "contact_id") | _numbers("x_mm", "y_mm", *_PRESSED, "area_mm2"),
    "predictions": _wholes("t_plate_ns") | _texts("finger_id") | _numbers("x_mm", "y_mm", "end_x_mm", "end_y_mm"),
    "targets": _texts("finger_id") | _numbers("target_um", "achieved_um", *PERCEIVED),
    "references": _wholes("t_knot_ns", "knot", "mode") | _numbers("reference_d_um", "reference_q_um"),
    "passes": {
        **_numbers("age_ms", "horizon_ms"),
        **_texts("state"),
        "is_limited": _TRUTHS,
        **_wholes("fingers", "knots", "gate_reasons"),
    },
    "board": {name: {WHOLE: _WHOLES, BOOL: _TRUTHS, TEXT: _TEXTS}[form] for name, form in _STATUS.items()},
    "modes": _wholes("mode") | _numbers("measured_d_um", "measured_q_um", "voltage_d_v", "voltage_q_v"),
    "ledger": _wholes(*LedgerLine._fields),
    "markers": _texts("client", "text", "fields_json"),
    "events": {
        **_wholes("number", "t_cause_ns", "t_device_ns"),  # 0 where there is none
        **_texts("kind", "finger_id"),
        **_numbers("x_mm", "y_mm"),
        **_texts("client", "surface", "effect"),
    },
    "streams": {**_texts("stream", "about"), **_numbers("rate_hz"), **_wholes("channel"), **_texts("name", "unit")},
    "measured": {**_texts("stream"), **_wholes("channel"), **_numbers("value")},  # of other devices, by `record --lsl`
    "messages": _texts("socket", "user", "message_json"),
    "links": {**_texts("device"), "is_up": _TRUTHS, **_texts("reason")},
    "truth": _wholes("path") | _texts("finger_id") | _numbers(*_TRUE),
    "truth_modes": _wholes("mode") | _numbers("plate_d_um", "plate_q_um"),
}


def tables(recording: Recording) -> dict[str, dict[str, Column]]:
    """All tables that have rows, each as columns by name. Raises RecordingError."""
    rows: dict[str, list[_Row]] = {name: [] for name in TABLES}
    for record in recording.records():
        for t_ns, name, row in _stamped(record):
            rows[name].append((1e-9 * (t_ns - recording.header.t_start_ns), t_ns, *row))
    return {name: _columns(name, found) for name, found in rows.items() if found}


def _columns(name: str, rows: list[_Row]) -> dict[str, Column]:
    types = {"t_s": _NUMBERS, "t_ns": _WHOLES} | TABLES[name]
    columns = zip(*rows, strict=True)
    return {column: np.array(values, dtype=kind) for (column, kind), values in zip(types.items(), columns, strict=True)}


def _stamped(record: Record) -> Iterator[tuple[int, str, _Row]]:
    """The rows that one record adds, with their instants: those of samples are their own."""
    if record.kind != "samples":
        yield from ((record.t_ns, name, row) for name, row in _rows(record))
        return
    for sample in record.fields["samples"]:
        for channel, value in enumerate(sample["values"], 1):
            yield sample["t_ns"], "measured", (record.fields["stream"], channel, value)


def _rows(record: Record) -> Iterator[tuple[str, _Row]]:
    """The rows that one record adds, and to which tables."""
    fields = record.fields
    match record.kind:
        case "reports":
            for report in fields["reports"]:
                yield "reports", (report["t_host_ns"], report["data"].hex())
        case "pass":
            yield from _pass_rows(record.t_ns, fields)
        case "status":
            yield "board", tuple(fields[name] for name in _STATUS)
            measured_um, voltage_v = fields["measured_um"], fields["voltage_v"]
            columns = (measured_um["d"], measured_um["q"], voltage_v["d"], voltage_v["q"])
            for mode, row in enumerate(zip(*columns, strict=False)):
                yield "modes", (mode, *row)
        case "ledger":
            yield "ledger", tuple(fields[name] for name in LedgerLine._fields)
        case "marker":
            yield "markers", (fields["client"], fields["text"], fields.get("fields_json", ""))
        case "event":
            whole = (fields["number"], fields["t_cause_ns"], fields.get("t_device_ns", 0))
            place = (fields.get("x_mm", np.nan), fields.get("y_mm", np.nan))
            names = (fields["client"], fields["surface"], fields["effect"])
            yield "events", (*whole, fields["kind"], str(fields.get("finger_id", "")), *place, *names)
        case "stream":
            for number, channel in enumerate(fields["channels"], 1):
                about = (fields["stream"], fields["about"], fields["rate_hz"])
                yield "streams", (*about, number, channel["name"], channel["unit"])
        case "targets" | "request":
            socket = "control" if record.kind == "request" else "targets"
            yield "messages", (socket, fields["user"], _as_json(fields["payload"]))
        case "board_link" | "trackpad_link":
            yield "links", (record.kind.removesuffix("_link"), fields["is_up"], fields["reason"])
        case "truth":
            for finger in fields["fingers"]:
                yield "truth", (finger["path"], str(key_of(finger)), *(finger.get(name, np.nan) for name in _TRUE))
            for mode, w_um in enumerate(zip(fields["modal_um"]["d"], fields["modal_um"]["q"], strict=False)):
                yield "truth_modes", (mode, *w_um)


def _pass_rows(t_ns: int, fields: Fields) -> Iterator[tuple[str, _Row]]:
    fingers, knots = fields["fingers"], fields.get("knots", [])
    t_sample_ns = t_ns - fields["age_ns"]
    spans_ms = fields["age_ns"] * 1e-6, fields["horizon_ns"] * 1e-6
    reasons = fields.get("gate_reasons", 0)
    yield "passes", (*spans_ms, fields["state"], fields["is_limited"], len(fingers), len(knots), reasons)
    for finger in fingers:
        found = (finger[name] for name in ("finger_id", "contact_id", "x_mm", "y_mm"))
        pressed = [finger.get(name, np.nan) for name in _PRESSED]
        yield "fingers", (t_sample_ns, *found, *pressed, 0.25 * np.pi * pressed[1] * pressed[2])
    for point in fields["points"]:
        key = str(key_of(point))
        places = (point[name] for name in ("x_mm", "y_mm", "end_x_mm", "end_y_mm"))
        yield "predictions", (t_sample_ns + fields["horizon_ns"], key, *places)
        perceived = (point.get(name, np.nan) for name in PERCEIVED)
        yield "targets", (key, point["target_um"], point["achieved_um"], *perceived)
    for number, knot in enumerate(knots):
        t_knot_ns, modal_um = fields.get("t_apply_ns", 0) + knot["dt_ns"], knot["modal_um"]
        for mode, w_um in enumerate(zip(modal_um["d"], modal_um["q"], strict=False)):
            yield "references", (t_knot_ns, number, mode, *w_um)


def _as_json(payload: bytes) -> str:
    """A client's message as text; bytes in it, and an invalid message, as hexadecimal."""
    try:
        message = msgpack.unpackb(payload, raw=False, strict_map_key=True, max_ext_len=0)
        return json.dumps(message, default=lambda value: value.hex() if isinstance(value, bytes) else str(value))
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return json.dumps(payload.hex())
