"""Decoder of the board's messages: bytes in pieces of any size to values; invalid frames are counted."""

from __future__ import annotations

import cmath
import struct
from collections.abc import Callable, Sequence
from functools import cache
from math import isfinite
from typing import Any, Final, get_args

from .. import board_protocol as protocol
from ..board_protocol import BoardState, PlainMessage
from ..board_values import (
    BoardController,
    BoardHello,
    BoardLog,
    BoardMessage,
    BoardStatus,
    LogEntry,
    ModeModel,
    ModeSample,
    SweepPoint,
    TelemetrySample,
)
from .commands import kinds
from .framing import FrameSplitter

FRAME_MAX: Final = 512  # encoded; the longest message, telemetry of eight modes, has 271 bytes
ALL_MODES: Final = 255  # in a log entry: no single mode is concerned

STATES: Final = {state.value: state for state in BoardState}
LAW_NAMES: Final = {number: name for name, number in protocol.LAWS.items()}


class BoardDecoder:
    """Decode bytes in pieces of any size to messages. Invalid bytes are counted by reason and never raise."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter(FRAME_MAX)
        self._refused = {"type": 0, "length": 0, "value": 0}
        self.invalid_types: set[int] = set()  # of messages that were refused for their length or a value

    @property
    def counters(self) -> dict[str, int]:
        """Refused frames by reason: oversize, cobs, crc, type, length, value."""
        return self._splitter.counters | self._refused

    def feed(self, data: bytes) -> tuple[BoardMessage, ...]:
        """Return the messages completed by `data`, in order."""
        messages = [self._message(frame) for frame in self._splitter.feed(data)]
        return tuple([message for message in messages if message is not None])

    def _message(self, frame: bytes) -> BoardMessage | None:
        read = _READERS.get(frame[0])
        if read is None:
            self._refused["type"] += 1
            return None
        try:
            message = read(frame[1:])
        except struct.error:
            message, fault = None, "length"
        else:
            fault = "value"
        if message is None:
            self._refused[fault] += 1
            self.invalid_types.add(frame[0])
        return message


def _plain(message: Any) -> Callable[[bytes], PlainMessage | None]:
    """Return the reader of a message whose fields are those of its payload, a phasor's d and q in one."""
    types = kinds(message).values()

    def read(payload: bytes) -> PlainMessage | None:
        numbers = iter(message.layout.unpack(payload))
        try:
            values = [kind(next(numbers), next(numbers)) if kind is complex else kind(next(numbers)) for kind in types]
        except ValueError:  # a number that an enumeration does not have
            return None
        is_sound = all(cmath.isfinite(value) for value in values if isinstance(value, (float, complex)))
        return message(*values) if is_sound else None

    return read


def _read_hello(payload: bytes) -> BoardHello | None:
    fields = dict(zip(protocol.HELLO_FIELDS, protocol.HELLO.unpack_from(payload), strict=True))
    modes = fields["modes"]
    # HELLO only grows: versions append after the limits; what is missing reads as 0, what is unknown is left out.
    w_limit_um = struct.unpack_from(f"<{modes}f", payload, protocol.HELLO.size)
    more = payload[protocol.HELLO.size + 4 * modes :].ljust(protocol.MORE_HELLO.size, b"\0")
    fields |= zip(protocol.MORE_HELLO_FIELDS, protocol.MORE_HELLO.unpack_from(more), strict=True)
    fields["firmware_version"] = fields["firmware_version"].rstrip(b"\0").decode("ascii", "replace")
    fields["has_sync"] = bool(fields.pop("features") & protocol.FEATURE_SYNC)
    figures = (*(fields[name] for name in ("control_hz", "drive_hz", "v_limit_v")), *w_limit_um)
    # 0: a misconfigured board, which does not drive
    is_sound = modes >= 1 and fields["firmware_version"].isprintable() and all(0.0 <= one < 1e9 for one in figures)
    return BoardHello(w_limit_um=w_limit_um, **fields) if is_sound else None


_MORE_STATUS: Final = protocol.MORE_STATUS.format
_ENDS_OF_STATUS: Final = [struct.calcsize(_MORE_STATUS[: n + 1]) for n in range(len(_MORE_STATUS))]  # between fields
_NUMBERED: Final = _ENDS_OF_STATUS[protocol.MORE_STATUS_FIELDS.index("number") + 1]
# Looked up once: one status comes for each report, and finds caches cold.
_STATUS_BYTES: Final[int] = protocol.STATUS.size
_MODE_BYTES: Final[int] = protocol.MODE.size
_MORE_BYTES: Final[int] = protocol.MORE_STATUS.size
_unpack_status: Final = protocol.STATUS.unpack_from
_unpack_more_status: Final = protocol.MORE_STATUS.unpack_from


def _read_status(payload: bytes) -> BoardStatus | None:
    numbers = _unpack_status(payload)  # by position
    t_us, state, flags, fault_code, modes, seq, t_received_us, t_applied_us, trips, bad_frames, late_frames = numbers
    values = _float_layout(4 * modes).unpack_from(payload, _STATUS_BYTES)
    more_at = _STATUS_BYTES + _MODE_BYTES * modes  # what follows grows, as that of HELLO
    more_bytes = len(payload) - more_at
    if more_bytes < _MORE_BYTES:
        if more_bytes not in _ENDS_OF_STATUS:
            return None
        payload = payload.ljust(more_at + _MORE_BYTES, b"\0")
    drive_hz, number, refused_seq, refusal, holdable = _unpack_more_status(payload, more_at)
    if not (state in STATES and flags <= 15 and modes >= 1 and isfinite(sum(values) + drive_hz)):
        return None
    # As `hapticd.values` says: one comes for each report.
    return tuple.__new__(BoardStatus, (
        t_us,
        STATES[state],
        seq,
        t_received_us,
        t_applied_us,
        flags & protocol.STATUS_APPLIED != 0,
        flags & protocol.STATUS_SATURATED != 0,
        flags & protocol.STATUS_LIMITED != 0,
        fault_code,
        trips,
        bad_frames,
        late_frames,
        tuple([complex(values[n], values[n + 1]) for n in range(0, 4 * modes, 4)]),
        tuple([complex(values[n], values[n + 1]) for n in range(2, 4 * modes, 4)]),
        drive_hz,
        flags & protocol.STATUS_PULSED != 0,
        number if more_bytes >= _NUMBERED else None,
        refused_seq,
        refusal,
        tuple([share / 255.0 for share in holdable.to_bytes(8, "little")[:modes]]) if holdable > 0 else (),
    ))  # fmt: skip


def _read_controller(payload: bytes) -> BoardController | None:
    law, bandwidth_1_s, integral_time_s, modes = protocol.CONTROLLER.unpack_from(payload)
    values = _floats(payload, protocol.CONTROLLER.size, 5 * modes)
    if not (modes >= 1 and all(map(isfinite, (bandwidth_1_s, integral_time_s, *values)))):
        return None
    fields = [values[start : start + 5] for start in range(0, len(values), 5)]
    models = tuple(ModeModel(decay, detuning, gain, complex(d, q)) for decay, detuning, gain, d, q in fields)
    return BoardController(LAW_NAMES.get(law), bandwidth_1_s, integral_time_s, models)


def _read_sweep_point(payload: bytes) -> SweepPoint | None:
    index, points, mode, modes, frequency_hz, voltage_v = protocol.SWEEP_POINT.unpack_from(payload)
    values = _floats(payload, protocol.SWEEP_POINT.size, 2 * modes)
    if not (mode < modes and index < points and all(map(isfinite, (frequency_hz, voltage_v, *values)))):
        return None
    return SweepPoint(index, points, mode, frequency_hz, voltage_v, tuple(_phasors(values)))


def _read_telemetry(payload: bytes) -> TelemetrySample | None:
    t_us, dropped, state, flags, modes = protocol.TELEMETRY.unpack_from(payload)
    values = _floats(payload, protocol.TELEMETRY.size, 8 * modes)
    if not (state in STATES and flags <= 7 and modes >= 1 and all(map(isfinite, values))):
        return None
    fields = [values[start : start + 8] for start in range(0, len(values), 8)]
    return TelemetrySample(
        t_board_us=t_us,
        dropped=dropped,
        state=STATES[state],
        saturated=bool(flags & protocol.STATUS_SATURATED),
        limited=bool(flags & protocol.STATUS_LIMITED),
        modes=tuple(map(_mode_sample, fields)),
    )


def _mode_sample(fields: Sequence[float]) -> ModeSample:
    reference_um, measured_um, voltage_v = _phasors(fields[:6])
    return ModeSample(reference_um, measured_um, voltage_v, decay_1_s=fields[6], detuning_rad_s=fields[7])


def _read_log(payload: bytes) -> BoardLog | None:
    cause, count, events = protocol.LOG.unpack_from(payload)
    if len(payload) != protocol.LOG.size + protocol.LOG_ENTRIES * protocol.LOG_ENTRY.size:
        raise struct.error
    entries = list(protocol.LOG_ENTRY.iter_unpack(payload[protocol.LOG.size :]))[:count]
    if not (count <= protocol.LOG_ENTRIES and count <= events and all(isfinite(entry[4]) for entry in entries)):
        return None
    log_entries = [
        LogEntry(t_us, boot_id, code, None if mode == ALL_MODES else mode, value)
        for t_us, boot_id, code, mode, value in entries
    ]
    return BoardLog(cause, events, tuple(log_entries))


def _floats(payload: bytes, start: int, count: int) -> tuple[float, ...]:
    """Unpack the `count` floats after the fixed part. Raises struct.error unless the payload ends with them."""
    return struct.unpack(f"<{count}f", payload[start:])


@cache
def _float_layout(count: int) -> struct.Struct:
    return struct.Struct(f"<{count}f")


def _phasors(re_im: Sequence[float]) -> list[complex]:
    return [complex(d, q) for d, q in zip(re_im[::2], re_im[1::2], strict=True)]


_READERS: Final[dict[int, Callable[[bytes], BoardMessage | None]]] = {
    **{message.kind: _plain(message) for message in get_args(PlainMessage)},
    protocol.MSG_HELLO: _read_hello,
    protocol.MSG_STATUS: _read_status,
    protocol.MSG_CONTROLLER: _read_controller,
    protocol.MSG_SWEEP_POINT: _read_sweep_point,
    protocol.MSG_TELEMETRY: _read_telemetry,
    protocol.MSG_LOG: _read_log,
}
