"""What a recording holds: one kind of record for each thing that a machine hears, does or finds.

A record's body is a MessagePack list, whose fields are named here with their units; the header repeats these names, so
that a file can be read without this one. Amplitudes are pairs (d, q): W = d + j q.

    heard     reports timer board_bytes board_link trackpad_link targets request watched stop disconnect: what `replay`
              feeds
    done      written                                                                    what `replay` compares
    found     pass status ledger marker                                                  what people look at
    beside    truth end                                                                  the plate's own; the reason
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgpack

from ...board_values import BoardStatus
from ...core.board.ledger import LedgerLine
from ...errors import RecordingError
from ...values import ClientTargets, Finger, RawReport, Tick
from .wanted import payload_of

Fields = Sequence[object]
Check = Callable[[object], bool]

MAX_WHOLE = 1 << 61  # 73 years in ns: sums of three still have 64 bits
LEDGER = ("seq", "t_sample_ns", "t_sent_ns", "t_applied_ns", "age_ns", "horizon_ns", "link_ns", "late_ns")


class Record(NamedTuple):
    """One record: its kind, its number, and the fields that `KINDS[kind]` names, of which `t_ns` is the first."""

    kind: str
    seq: int
    fields: tuple[Any, ...]

    @property
    def t_ns(self) -> int:
        """When the machine heard, did or found it, on the recording host's monotonic clock."""
        return int(self.fields[0])


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind: its number, its fields' names and what each must be, and how values become fields."""

    number: int
    names: tuple[str, ...]
    checks: tuple[Check, ...]
    flatten: Callable[..., Fields]


# --- what a field may be ------------------------------------------------------------------------------------------


def _whole(value: object) -> bool:
    return type(value) is int and -MAX_WHOLE <= value <= MAX_WHOLE


def _number(value: object) -> bool:
    return type(value) is float or _whole(value)


def _truth(value: object) -> bool:
    return type(value) is bool


def _text(value: object) -> bool:
    return type(value) is str


def _bytes(value: object) -> bool:
    return type(value) is bytes


def _key(value: object) -> bool:
    return _whole(value) or _text(value)


def _or_nil(check: Check) -> Check:
    return lambda value: value is None or check(value)


def _each(check: Check) -> Check:
    return lambda value: type(value) is list and all(map(check, value))


def _row(*checks: Check) -> Check:
    def fits(value: object) -> bool:
        if type(value) is not list or len(value) != len(checks):
            return False
        return all(check(item) for check, item in zip(checks, value, strict=True))

    return fits


_AMPLITUDES = _each(_row(_number, _number))
_PAIR = _row(_number, _number)


# --- how values become fields -------------------------------------------------------------------------------------


def _as_they_are(*values: object) -> Fields:
    return values


def _reports(batch: Sequence[RawReport]) -> Fields:
    return ([[report.t_host_ns, report.data] for report in batch],)


def _targets(payload: bytes | ClientTargets, user: str) -> Fields:
    return payload if isinstance(payload, bytes) else payload_of(payload), user


def pairs(amplitudes: Sequence[complex]) -> list[list[float]]:
    """Amplitudes as they are recorded."""
    return [[w.real, w.imag] for w in amplitudes]


def _pass(tick: Tick, state: str, fingers: Sequence[Finger]) -> Fields:
    drive = tick.drive
    return (
        tick.age_ns,
        tick.horizon_ns,
        state,
        tick.limited,
        [[finger.finger_id, finger.contact_id, finger.x_mm, finger.y_mm] for finger in fingers],
        [list(point) for point in tick.points],
        None if drive is None else drive.t_apply_ns,
        0 if drive is None else int(drive.reasons),
        [] if drive is None else [[knot.dt_ns, pairs(knot.modal_um)] for knot in drive.knots],
    )


def _status(status: BoardStatus) -> Fields:
    return (
        status.t_board_us,
        status.state.name,
        status.seq,
        status.t_received_us,
        status.t_applied_us,
        status.applied,
        status.saturated,
        status.limited,
        status.fault_code,
        status.deadman_trips,
        status.bad_frames,
        status.late_frames,
        pairs(status.measured_um),
        pairs(status.voltage_v),
    )


def _ledger(line: LedgerLine) -> Fields:
    return [getattr(line, name) for name in LEDGER]


# --- the kinds ----------------------------------------------------------------------------------------------------


def _kind(number: int, flatten: Callable[..., Fields], fields: dict[str, Check]) -> Kind:
    return Kind(number, ("t_ns", *fields), (_whole, *fields.values()), flatten)


KINDS: dict[str, Kind] = {
    "reports": _kind(1, _reports, {"reports [t_host_ns, data]": _each(_row(_whole, _bytes))}),
    "timer": _kind(2, _as_they_are, {}),
    "board_bytes": _kind(3, _as_they_are, {"data": _bytes}),
    "board_link": _kind(4, _as_they_are, {"is_up": _truth, "reason": _text}),
    "trackpad_link": _kind(5, _as_they_are, {"is_up": _truth, "reason": _text, "model": _or_nil(_text)}),
    "targets": _kind(6, _targets, {"payload": _bytes, "user": _text}),
    "request": _kind(7, _as_they_are, {"payload": _bytes, "user": _text}),
    "stop": _kind(8, _as_they_are, {}),
    "disconnect": _kind(9, _as_they_are, {}),
    "watched": _kind(10, _as_they_are, {"is_watched": _truth}),
    "written": _kind(16, _as_they_are, {"line": _bytes, "is_accepted": _truth}),
    "pass": _kind(
        32,
        _pass,
        {
            "age_ns": _whole,
            "horizon_ns": _whole,
            "state": _text,
            "is_limited": _truth,
            "fingers [finger_id, contact_id, x_mm, y_mm]": _each(_row(_whole, _whole, _number, _number)),
            "points [key, x_mm, y_mm, target_um, achieved_um, end_x_mm, end_y_mm]": _each(_row(_key, *[_number] * 6)),
            "t_apply_ns": _or_nil(_whole),
            "gate_reasons": _whole,
            "knots [dt_ns, modal_um]": _each(_row(_whole, _AMPLITUDES)),
        },
    ),
    "status": _kind(
        33,
        _status,
        {
            "t_board_us": _whole,
            "state": _text,
            "seq": _whole,
            "t_received_us": _whole,
            "t_applied_us": _whole,
            "is_applied": _truth,
            "is_saturated": _truth,
            "is_limited": _truth,
            "fault_code": _whole,
            "deadman_trips": _whole,
            "bad_frames": _whole,
            "late_frames": _whole,
            "measured_um": _AMPLITUDES,
            "voltage_v": _AMPLITUDES,
        },
    ),
    "ledger": _kind(34, _ledger, dict.fromkeys(LEDGER, _whole)),
    "marker": _kind(35, _as_they_are, {"client": _text, "text": _text}),
    "truth": _kind(
        48,
        _as_they_are,
        {
            "finger_mm": _each(_or_nil(_PAIR)),
            "target_um": _each(_or_nil(_number)),
            "modal_um": _AMPLITUDES,
            "truth_um": _each(_or_nil(_PAIR)),
        },
    ),
    "end": _kind(63, _as_they_are, {"reason": _text}),
}
HEARD = (
    "reports",
    "timer",
    "board_bytes",
    "board_link",
    "trackpad_link",
    "targets",
    "request",
    "watched",
    "stop",
    "disconnect",
)
_NAMES = {kind.number: name for name, kind in KINDS.items()}


def body_of(kind: str, t_ns: int, values: tuple[Any, ...]) -> bytes:
    """A record's body from the values that the machine's tap was given."""
    return bytes(msgpack.packb([t_ns, *KINDS[kind].flatten(*values)]))


def record_of(number: int, seq: int, body: bytes) -> Record | None:
    """The record; None where its kind is a newer hapticd's. Raises RecordingError for a body that is not its kind's."""
    name = _NAMES.get(number)
    if name is None:
        return None
    try:
        fields = msgpack.unpackb(body, raw=False, strict_map_key=True, max_ext_len=0)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        fields = None
    kind = KINDS[name]
    if not _row(*kind.checks)(fields):
        raise RecordingError(f"Record {seq} is none of kind {name}: it is left out.")
    return Record(name, seq, tuple(fields))


def described() -> dict[str, object]:
    """All kinds, as the header tells them: numbers and the names of the fields."""
    return {name: {"number": kind.number, "fields": list(kind.names)} for name, kind in KINDS.items()}
