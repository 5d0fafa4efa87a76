"""Kinds of records: one for each thing that a machine receives, decides or finds, with its topic, form and encoding.

    input   reports timer board_bytes board_link trackpad_link targets request watched
            budget person self_test stop disconnect: fed by `replay`
    output  written                                                                     compared by `replay`
    found   pass event status ledger marker                                             for people and other programs
    added   truth end                                                                   the plate's own; the last record

Inputs and outputs are MessagePack, whose bytes replay needs; the others are JSON with a schema, which PlotJuggler and
Foxglove draw as it is.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias, get_args, get_type_hints

import msgpack

from hapticd_contract.states import Perceived, PlateEvent
from hapticd_contract.targets import ClientTargets

from ...board_values import BoardStatus
from ...errors import RecordingError
from ...values import Finger, LedgerLine, RawReport, Tick
from ...wire.client import encode_targets
from ...wire.trackpad import Pad, from_fields, to_fields

MAX_WHOLE = 1 << 61  # 73 years in ns: sums of three still have 64 bits
MAX_MESSAGE_BYTES = 1 << 20
MAX_HEADER_BYTES = 1 << 22  # the header holds the mode map: at most 250 000 values of 8 bytes
HEADER = "header"
MAX_CONTAINERS = 10_000  # of a message of more than SMALL_BYTES: an empty one takes seventy times its byte
SMALL_BYTES = 1 << 16

Fields: TypeAlias = dict[str, Any]

_JSON = json.JSONEncoder(separators=(",", ":"), allow_nan=False, check_circular=False)


class Record(NamedTuple):
    """One record. `seq` counts the records of a recording; `t_ns` is the recording host's monotonic clock."""

    kind: str
    seq: int
    t_ns: int
    fields: Fields


# --- forms: a name of `_CHECKS`, [form] for a list, {name: form} for an object --------------------------------------

WHOLE, NUMBER, BOOL, TEXT, BYTES = "integer", "number", "boolean", "string", "bytes"


class Maybe(NamedTuple):
    """A member of an object that may be absent."""

    form: _Form


_Form: TypeAlias = "str | list[_Form] | dict[str, _Form | Maybe]"
AMPLITUDES: dict[str, _Form | Maybe] = {"d": [NUMBER], "q": [NUMBER]}


_PAD: _Form = {
    "model": TEXT,
    "layout": TEXT,
    "period_ns": WHOLE,
    "x_raw": [WHOLE],
    "y_raw": [WHOLE],
    "size_mm": [NUMBER],
    "pressure_max_raw": Maybe(WHOLE),
    "quarter_turn_raw": Maybe(WHOLE),
}


def _is_whole(value: object) -> bool:
    return type(value) is int and -MAX_WHOLE <= value <= MAX_WHOLE


_CHECKS: dict[str, Callable[[Any], bool]] = {
    WHOLE: _is_whole,
    NUMBER: lambda value: (type(value) is float and math.isfinite(value)) or _is_whole(value),
    BOOL: lambda value: type(value) is bool,
    TEXT: lambda value: type(value) is str,
    BYTES: lambda value: type(value) is bytes,
}


def fits(value: Any, form: _Form) -> bool:
    """Whether a decoded value has this form."""
    if isinstance(form, str):
        return _CHECKS[form](value)
    if isinstance(form, list):
        return type(value) is list and all(fits(item, form[0]) for item in value)
    if type(value) is not dict or not value.keys() <= form.keys():
        return False
    for name, member in form.items():
        if name not in value:
            if not isinstance(member, Maybe):
                return False
        elif not fits(value[name], member.form if isinstance(member, Maybe) else member):
            return False
    return True


def json_schema(form: _Form) -> dict[str, Any]:
    """The same as JSON Schema."""
    if isinstance(form, str):
        return {"type": form}
    if isinstance(form, list):
        return {"type": "array", "items": json_schema(form[0])}
    members = {name: member.form if isinstance(member, Maybe) else member for name, member in form.items()}
    return {
        "type": "object",
        "properties": {name: json_schema(member) for name, member in members.items()},
        "required": [name for name, member in form.items() if not isinstance(member, Maybe)],
    }


# --- how a machine's values become fields ---------------------------------------------------------------------------


def amplitudes(phasors: Sequence[complex]) -> Fields:
    """Modal phasors W = d + j q as they are recorded."""
    return {"d": [w.real for w in phasors], "q": [w.imag for w in phasors]}


def key_of(point: Mapping[str, Any]) -> int | str:
    """The finger of a recorded point: an id, or the name of a virtual finger."""
    key: int | str = point["finger_id"] if "finger_id" in point else point.get("virtual", "")
    return key


def _reports(batch: Sequence[RawReport]) -> Fields:
    return {"reports": [{"t_host_ns": report.t_host_ns, "data": report.data} for report in batch]}


def _message(payload: bytes | ClientTargets, user: str, waited_ns: int) -> Fields:
    packed = payload if isinstance(payload, bytes) else encode_targets(payload)
    return {"payload": packed, "user": user, "waited_ns": waited_ns}


def _trackpad_link(is_up: bool, reason: str, pad: Pad | None) -> Fields:
    fields: Fields = {"is_up": is_up, "reason": reason}
    return fields if pad is None else fields | {"pad": to_fields(pad)}


def pad_of(link: Fields) -> Pad | None:
    """Return the pad of a `trackpad_link`, None without one; earlier ones name its model. Raises RecordingError."""
    if "pad" not in link and "model" not in link:
        return None
    try:
        return from_fields(link.get("pad", link))
    except ValueError as error:
        raise RecordingError(f"The recording's trackpad cannot be read: {error}.") from None


def _pass(tick: Tick, state: str, fingers: Sequence[Finger], perceived: Mapping[int | str, Perceived]) -> Fields:
    fields: Fields = {
        "age_ns": tick.age_ns,
        "horizon_ns": tick.horizon_ns,
        "state": state,
        "is_limited": tick.limited,
        "fingers": [_finger(finger) for finger in fingers],
        "points": [
            {"virtual" if isinstance(key, str) else "finger_id": key}
            | dict(zip(_POINT, numbers, strict=True))
            | (_known(perceived[key]) if key in perceived else {})  # it is not known without a reader
            for key, *numbers in tick.points
        ],
    }
    if tick.drive is not None:
        fields["t_apply_ns"] = tick.drive.t_apply_ns
        fields["gate_reasons"] = int(tick.drive.reasons)
        fields["knots"] = [{"dt_ns": knot.dt_ns, "modal_um": amplitudes(knot.modal_um)} for knot in tick.drive.knots]
    return fields


def _finger(finger: Finger) -> Fields:
    """A finger, with the ellipse that its pad reports, if it reports any."""
    names = _FINGER if finger.major_mm > 0.0 else _FINGER.keys() - _REPORTED_AXES
    return {name: getattr(finger, name) for name in _FINGER if name in names}


def _known(perceived: Perceived) -> Fields:
    return {name: number for name in PERCEIVED if (number := getattr(perceived, name)) is not None}


def _event(event: PlateEvent) -> Fields:
    values = {name: getattr(event, name) for name in PlateEvent.__struct_fields__}
    return {_EVENT_NAMES.get(name, name): value for name, value in values.items() if value is not None}


def _marker(client: str, text: str, values: Mapping[str, object]) -> Fields:
    made: Fields = {"client": client, "text": text}
    return made | {"fields_json": json.dumps(values)} if values else made


def _status(status: BoardStatus) -> Fields:
    return {
        **{name: getattr(status, name) for name in _COUNTERS},
        **{f"is_{name}": getattr(status, name) for name in (*_FLAGS, "pulsed")},
        "state": status.state.name,
        "measured_um": amplitudes(status.measured_um),
        "voltage_v": amplitudes(status.voltage_v),
    }


_EVENT_NAMES = {"seq": "number", "t_ns": "t_cause_ns", "finger": "finger_id"}
_FORMS: dict[Any, str] = {int: WHOLE, float: NUMBER, str: TEXT}
_EVENT: dict[str, _Form | Maybe] = {  # each field of the contract's
    _EVENT_NAMES.get(name, name): _FORMS[kind] if kind in _FORMS else Maybe(_FORMS[get_args(kind)[0]])
    for name, kind in get_type_hints(PlateEvent).items()
}
_REPORTED_AXES = {"major_mm", "minor_mm", "angle_rad"}
_FINGER: dict[str, _Form | Maybe] = {
    "finger_id": WHOLE,
    "contact_id": WHOLE,
    "x_mm": NUMBER,
    "y_mm": NUMBER,
    "pressure_frac": Maybe(NUMBER),
    "major_mm": Maybe(NUMBER),
    "minor_mm": Maybe(NUMBER),
    "angle_rad": Maybe(NUMBER),
}
_POINT = ("x_mm", "y_mm", "target_um", "achieved_um", "end_x_mm", "end_y_mm")  # as in TouchPoint, behind its key
PERCEIVED = Perceived.__struct_fields__
MISSES = "misses_target"  # the only one that is no number
_COUNTERS = (
    *("t_board_us", "seq", "t_received_us", "t_applied_us"),
    *("fault_code", "deadman_trips", "bad_frames", "late_frames"),
)
_FLAGS = ("applied", "saturated", "limited")


# --- the kinds ------------------------------------------------------------------------------------------------------


class Kind(NamedTuple):
    """One kind: its topic, the form of its fields, and what makes them of the values that the observer is given."""

    topic: str
    form: dict[str, _Form | Maybe]
    flatten: Callable[..., Fields]

    @property
    def encoding(self) -> str:
        """MCAP's name of it."""
        return "msgpack" if self.topic.startswith(("/input", "/output", f"/{HEADER}")) else "json"


def _kind(topic: str, form: dict[str, _Form | Maybe], flatten: Callable[..., Fields] | None = None) -> Kind:
    def named(*values: object) -> Fields:
        return dict(zip(form, values, strict=True))

    return Kind(topic, form, named if flatten is None else flatten)


_TRUE_FINGER: dict[str, _Form | Maybe] = {
    "path": WHOLE,  # number of the simulated finger, from 1
    "finger_id": Maybe(WHOLE),  # as in a pass, while the daemon has it
    "virtual": Maybe(TEXT),
    "x_mm": NUMBER,
    "y_mm": NUMBER,
    "target_um": Maybe(NUMBER),
    "plate_d_um": NUMBER,
    "plate_q_um": NUMBER,
}
_CHANNEL: dict[str, _Form | Maybe] = {"name": TEXT, "unit": TEXT}
# `waited_ns` is missing in earlier recordings.
_MESSAGE: dict[str, _Form | Maybe] = {"payload": BYTES, "user": TEXT, "waited_ns": Maybe(WHOLE)}

_POINT_FORM: dict[str, _Form | Maybe] = {
    "finger_id": Maybe(WHOLE),
    "virtual": Maybe(TEXT),
    **dict.fromkeys(_POINT, NUMBER),
    **{name: Maybe(BOOL if name == MISSES else NUMBER) for name in PERCEIVED},  # missing in earlier recordings
}

KINDS: dict[str, Kind] = {
    HEADER: _kind(f"/{HEADER}", {}),  # its fields are checked in header.py
    "reports": _kind("/input/reports", {"reports": [{"t_host_ns": WHOLE, "data": BYTES}]}, _reports),
    "timer": _kind("/input/timer", {}),
    "board_bytes": _kind("/input/board_bytes", {"data": BYTES}),
    "board_link": _kind("/input/board_link", {"is_up": BOOL, "reason": TEXT}),
    "trackpad_link": _kind(
        "/input/trackpad_link",
        {"is_up": BOOL, "reason": TEXT, "model": Maybe(TEXT), "pad": Maybe(_PAD)},
        _trackpad_link,
    ),
    "targets": _kind("/input/targets", _MESSAGE, _message),
    "request": _kind("/input/request", _MESSAGE, _message),
    "watched": _kind("/input/watched", {"is_watched": BOOL}),
    "self_test": _kind("/input/self_test", {"outcome": TEXT, "text": TEXT}),
    "person": _kind(
        "/input/person",
        {"name": TEXT, "friction_curve_um": [NUMBER], "floor_frac": NUMBER, "speed_mm_s": NUMBER},
    ),
    "budget": _kind("/input/budget", {"frac": NUMBER}),
    "stop": _kind("/input/stop", {}),
    "disconnect": _kind("/input/disconnect", {}),
    "written": _kind("/output/written", {"line": BYTES, "is_accepted": BOOL}),
    "pass": _kind(
        "/pass",
        {
            "age_ns": WHOLE,
            "horizon_ns": WHOLE,
            "state": TEXT,
            "is_limited": BOOL,
            "fingers": [_FINGER],
            "points": [_POINT_FORM],
            "t_apply_ns": Maybe(WHOLE),
            "gate_reasons": Maybe(WHOLE),
            "knots": Maybe([{"dt_ns": WHOLE, "modal_um": AMPLITUDES}]),
        },
        _pass,
    ),
    "status": _kind(
        "/status",
        {
            **dict.fromkeys(_COUNTERS, WHOLE),
            **{f"is_{name}": BOOL for name in _FLAGS},
            "is_pulsed": Maybe(BOOL),  # missing in earlier recordings
            "state": TEXT,
            "measured_um": AMPLITUDES,
            "voltage_v": AMPLITUDES,
        },
        _status,
    ),
    "ledger": _kind("/ledger", dict.fromkeys(LedgerLine._fields, WHOLE), LedgerLine._asdict),
    "marker": _kind("/marker", {"client": TEXT, "text": TEXT, "fields_json": Maybe(TEXT)}, _marker),
    "stream": _kind("/measured/stream", {"stream": TEXT, "about": TEXT, "rate_hz": NUMBER, "channels": [_CHANNEL]}),
    "samples": _kind("/measured/samples", {"stream": TEXT, "samples": [{"t_ns": WHOLE, "values": [NUMBER]}]}),
    "truth": _kind("/truth", {"fingers": [_TRUE_FINGER], "modal_um": AMPLITUDES}),
    "end": _kind("/end", {"reason": TEXT}),
    "event": _kind("/event", _EVENT, _event),
}
INPUTS = tuple(name for name, kind in KINDS.items() if kind.topic.startswith("/input/"))


def record_of(kind: str, seq: int, t_ns: int, values: tuple[Any, ...]) -> Record:
    """A record of the values that a machine's observer was given."""
    return Record(kind, seq, t_ns, KINDS[kind].flatten(*values))


def encode(kind: str, fields: Fields) -> bytes:
    """A message's bytes. Raises RecordingError for what no reader would take."""
    try:
        data = bytes(msgpack.packb(fields)) if KINDS[kind].encoding == "msgpack" else _JSON.encode(fields).encode()
    except (ValueError, TypeError, OverflowError) as error:  # such as a number that is not finite
        raise RecordingError(f"A record of kind {kind} cannot be kept: {error}.") from None
    longest = MAX_HEADER_BYTES if kind == HEADER else MAX_MESSAGE_BYTES
    if len(data) > longest:
        raise RecordingError(f"A record of {len(data)} bytes cannot be kept: at most {longest} can.")
    return data


def _bounds(data: bytes) -> dict[str, Callable[[Any], Any]]:
    """Hooks of the library that count the containers of a long message, and raise ValueError for too many."""
    if len(data) <= SMALL_BYTES:
        return {}
    found = itertools.count(1)

    def counted(container: Any) -> Any:
        if next(found) > MAX_CONTAINERS:
            raise ValueError("too many containers")
        return container

    return {"list_hook": counted, "object_hook": counted}


def decode(kind: str, data: bytes) -> Fields:
    """A message's fields. Raises RecordingError where they are not its kind's."""
    try:
        if KINDS[kind].encoding == "msgpack":
            fields = msgpack.unpackb(data, raw=False, strict_map_key=True, max_ext_len=0, **_bounds(data))
        else:
            fields = json.loads(data)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        fields = None
    if type(fields) is not dict or not (kind == HEADER or fits(fields, KINDS[kind].form)):
        raise RecordingError(f"A message of {KINDS[kind].topic} has not the form of its kind.")
    return fields
