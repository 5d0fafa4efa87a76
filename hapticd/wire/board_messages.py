"""Decoder of the board's messages: bytes in pieces of any size to values; invalid frames are counted."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Final

from ..board_values import (
    BoardController,
    BoardHello,
    BoardLog,
    BoardMessage,
    BoardState,
    BoardStatus,
    BoardTime,
    BoardVerdict,
    LogEntry,
    ModeModel,
    ModeSample,
    SweepPoint,
    TelemetrySample,
    ToolMessage,
    Verdict,
)
from . import protocol
from .framing import FrameSplitter

FRAME_MAX: Final = 512  # encoded; the longest message, telemetry of eight modes, has 271 bytes

STATES: Final = {state.value: state for state in BoardState}
VERDICTS: Final = {verdict.value: verdict for verdict in Verdict}
LAW_NAMES: Final = {number: name for name, number in protocol.LAWS.items()}


class Decoder:
    """Decode bytes in pieces of any size to messages. Invalid bytes are counted by reason and never raise."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter(FRAME_MAX)
        self._refused = {"type": 0, "length": 0, "value": 0}
        self.invalid_types: set[int] = set()  # of messages that were refused for their length or a value

    @property
    def counters(self) -> dict[str, int]:
        """Refused frames by reason: oversize, cobs, crc, type, length, value."""
        return self._splitter.counters | self._refused

    def feed(self, data: bytes) -> tuple[BoardMessage | ToolMessage, ...]:
        """Return the messages completed by `data`, in order."""
        messages = map(self._message, self._splitter.feed(data))
        return tuple(message for message in messages if message is not None)

    def _message(self, frame: bytes) -> BoardMessage | ToolMessage | None:
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


def _read_hello(payload: bytes) -> BoardHello | None:
    version, protocol_hash, modes, name, boot_id, control_hz, drive_hz, deadman_ms, v_limit_v = (
        protocol.HELLO.unpack_from(payload)
    )
    # HELLO only grows: versions append after the limits; what is missing reads as 0, what is unknown is left out.
    w_limit_um = struct.unpack_from(f"<{modes}f", payload, protocol.HELLO.size)
    more = payload[protocol.HELLO.size + 4 * modes :].ljust(protocol.MORE_HELLO.size, b"\0")
    image_crc, baud_max, features, commands = protocol.MORE_HELLO.unpack_from(more)
    text = name.rstrip(b"\0").decode("ascii", "replace")
    figures = (control_hz, drive_hz, v_limit_v, *w_limit_um)  # 0: a misconfigured board, which does not drive
    if not (modes >= 1 and text.isprintable() and all(0.0 <= figure < 1e9 for figure in figures)):
        return None
    return BoardHello(
        protocol_version=version,
        protocol_hash=protocol_hash,
        firmware_version=text,
        boot_id=boot_id,
        modes=modes,
        control_hz=control_hz,
        drive_hz=drive_hz,
        deadman_ms=deadman_ms,
        w_limit_um=w_limit_um,
        v_limit_v=v_limit_v,
        image_crc=image_crc,
        baud_max=baud_max,
        has_sync=bool(features & protocol.FEATURE_SYNC),
        commands=commands,
    )


_ENDS_OF_STATUS: Final = [struct.calcsize(protocol.MORE_STATUS.format[:n]) for n in range(1, 6)]  # between fields


def _read_status(payload: bytes) -> BoardStatus | None:
    t_us, state, flags, fault, modes, seq, received_us, applied_us, trips, bad, late = protocol.STATUS.unpack_from(
        payload
    )
    values = struct.unpack_from(f"<{4 * modes}f", payload, protocol.STATUS.size)
    more = payload[protocol.STATUS.size + 16 * modes :]  # which grows, as that of HELLO
    is_numbered = len(more) >= protocol.MORE_STATUS.size
    if not is_numbered and len(more) not in _ENDS_OF_STATUS:
        return None
    drive_hz, number, refused_seq, refusal = protocol.MORE_STATUS.unpack_from(
        more.ljust(protocol.MORE_STATUS.size, b"\0")
    )
    if not (state in STATES and flags <= 15 and modes >= 1 and all(map(isfinite, (*values, drive_hz)))):
        return None
    phasors = _phasors(values)
    return BoardStatus(
        t_board_us=t_us,
        state=STATES[state],
        seq=seq,
        t_received_us=received_us,
        t_applied_us=applied_us,
        applied=bool(flags & 1),
        saturated=bool(flags & 2),
        limited=bool(flags & 4),
        fault_code=fault,
        deadman_trips=trips,
        bad_frames=bad,
        late_frames=late,
        measured_um=tuple(phasors[::2]),
        voltage_v=tuple(phasors[1::2]),
        drive_hz=drive_hz,
        pulsed=bool(flags & 8),
        number=number if is_numbered else None,
        refused_seq=refused_seq,
        refusal=refusal,
    )


def _read_time(payload: bytes) -> BoardTime | None:
    return BoardTime(*protocol.TIME.unpack(payload))


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
        saturated=bool(flags & 2),
        limited=bool(flags & 4),
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
        LogEntry(t_us, boot_id, code, None if mode == protocol.ALL_MODES else mode, value)
        for t_us, boot_id, code, mode, value in entries
    ]
    return BoardLog(cause, events, tuple(log_entries))


def _read_verdict(payload: bytes) -> BoardVerdict | None:
    request, verdict = protocol.VERDICT.unpack(payload)
    return BoardVerdict(request, VERDICTS[verdict]) if verdict in VERDICTS else None


def _floats(payload: bytes, start: int, count: int) -> tuple[float, ...]:
    """Unpack the `count` floats after the fixed part. Raises struct.error unless the payload ends with them."""
    return struct.unpack(f"<{count}f", payload[start:])


def _phasors(re_im: Sequence[float]) -> list[complex]:
    return [complex(d, q) for d, q in zip(re_im[::2], re_im[1::2], strict=True)]


_READERS: Final[dict[int, Callable[[bytes], BoardMessage | ToolMessage | None]]] = {
    protocol.MSG_HELLO: _read_hello,
    protocol.MSG_STATUS: _read_status,
    protocol.MSG_TIME: _read_time,
    protocol.MSG_CONTROLLER: _read_controller,
    protocol.MSG_SWEEP_POINT: _read_sweep_point,
    protocol.MSG_TELEMETRY: _read_telemetry,
    protocol.MSG_LOG: _read_log,
    protocol.MSG_VERDICT: _read_verdict,
}
