from __future__ import annotations

import dataclasses
import math
import re
import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd import board_protocol as protocol
from hapticd.board_protocol import BoardState, BoardTime, BoardVerdict, CommandResult
from hapticd.board_values import (
    BoardCalibration,
    BoardController,
    BoardHello,
    BoardLog,
    BoardStatus,
    LogEntry,
    ModeCalibration,
    ModeModel,
    ModeSample,
    SweepPoint,
    TelemetrySample,
)
from hapticd.errors import DeviceError
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import commands, device
from hapticd.wire.framing import FrameSplitter, encode_frame

HELLO = protocol.HELLO.pack(
    protocol.PROTOCOL_VERSION, protocol.PROTOCOL_HASH, 2, b"0.1.0", 77, 2000.0, 29205.0, 50, 150.0
) + struct.pack("<ff", 4.0, 4.0)
STATUS = protocol.STATUS.pack(123_456, 1, 3, 0, 2, 9, 120_000, 122_000, 1, 2, 3) + struct.pack("<8f", *range(8))
TIME = protocol.TIME.pack(10**18, 4_000_000_000, 4_000_000_100)
CONTROLLER = protocol.CONTROLLER.pack(1, 900.0, 0.25, 2) + struct.pack("<10f", *range(10))
SWEEP_POINT = protocol.SWEEP_POINT.pack(3, 31, 1, 2, 29205.0, 12.5) + struct.pack("<4f", *range(4))
TELEMETRY = protocol.TELEMETRY.pack(123_456, 7, 3, 2, 2) + struct.pack("<16f", *range(16))
LOG_ENTRIES = [protocol.LOG_ENTRY.pack(1000 + i, 77, 3 + i, 255 * (i % 2), 0.5) for i in range(2)]
LOG = protocol.LOG.pack(4, 2, 2) + b"".join(LOG_ENTRIES) + bytes(6 * protocol.LOG_ENTRY.size)
VERDICT = protocol.VERDICT.pack(protocol.MSG_SWEEP, 2)
TO_HOST = {
    protocol.MSG_HELLO: HELLO,
    protocol.MSG_STATUS: STATUS,
    protocol.MSG_TIME: TIME,
    protocol.MSG_CONTROLLER: CONTROLLER,
    protocol.MSG_SWEEP_POINT: SWEEP_POINT,
    protocol.MSG_TELEMETRY: TELEMETRY,
    protocol.MSG_LOG: LOG,
    protocol.MSG_VERDICT: VERDICT,
}


def frame(message_type: int, payload: bytes) -> bytes:
    return encode_frame(bytes((message_type,)) + payload)


def drive(*knots: Knot) -> SafeDrive:
    return SafeDrive(0, knots, LimitReason.NONE)


def payload_of(line: bytes) -> bytes:
    (message,) = FrameSplitter(1000).feed(line)
    return message[1:]


def decoded_knots(line: bytes) -> list[tuple[int, list[complex]]]:
    """Knots of a reference frame as a board reads them: float32."""
    payload = payload_of(line)
    _, _, knots, modes = protocol.REFERENCE.unpack_from(payload)
    width = 2 + 8 * modes
    rows = []
    for i in range(knots):
        offset, *parts = struct.unpack_from(f"<H{2 * modes}f", payload, protocol.REFERENCE.size + i * width)
        rows.append((offset, [complex(d, q) for d, q in zip(parts[::2], parts[1::2], strict=True)]))
    return rows


# --- to the board -----------------------------------------------------------------------------------------------

PHASORS = st.complex_numbers(max_magnitude=1e6, allow_nan=False, allow_infinity=False)


@given(st.lists(st.tuples(PHASORS, PHASORS), min_size=1, max_size=24))
def test_rounding_to_float32_never_lets_a_magnitude_grow(rows: list[tuple[complex, complex]]) -> None:
    knots = [Knot(i * 1_000_000, row) for i, row in enumerate(rows)]
    for (_, sent), row in zip(decoded_knots(device.encode_reference(0, drive(*knots), 0)), rows, strict=True):
        for w_sent, w in zip(sent, row, strict=True):
            for part_sent, part in ((w_sent.real, w.real), (w_sent.imag, w.imag)):
                if abs(part) > np.finfo(np.float32).tiny:
                    assert abs(part_sent) <= abs(part)
                    assert abs(part_sent - part) <= 2.0**-23 * abs(part)


@given(st.lists(st.integers(0, commands.OFFSET_MAX_NS), min_size=1, max_size=24, unique=True).map(sorted))
def test_knots_stay_in_order_and_within_two_microseconds_of_their_time(dt_ns: list[int]) -> None:
    spread = [dt for dt, after in pairwise([*dt_ns, math.inf]) if after - dt >= protocol.KNOT_UNIT_NS] or dt_ns[:1]
    line = device.encode_reference(0, drive(*(Knot(dt, (0j,)) for dt in spread)), 0)
    offsets = [offset for offset, _ in decoded_knots(line)]
    assert all(a < b for a, b in pairwise(offsets))
    assert all(abs(o * protocol.KNOT_UNIT_NS - dt) <= 2000 for o, dt in zip(offsets, spread, strict=True))


@pytest.mark.parametrize(
    "knots",
    [(), tuple(Knot(i * 10_000, (0j,)) for i in range(25)), (Knot(-1, (0j,)),), (Knot(263_000_000, (0j,)),)],
    ids=["none", "too many", "before the frame", "too late"],
)
def test_a_polyline_that_does_not_fit_a_frame_is_refused(knots: tuple[Knot, ...]) -> None:
    with pytest.raises(ValueError, match=r"\b[Kk]nots?\b"):
        device.encode_reference(0, drive(*knots), 0)


# --- from the board ---------------------------------------------------------------------------------------------


def test_each_message_becomes_its_value() -> None:
    messages = device.Decoder().feed(b"".join(frame(kind, payload) for kind, payload in TO_HOST.items()))
    hello, status, time, controller, point, sample, log, verdict = messages
    assert hello == BoardHello(
        protocol.PROTOCOL_VERSION, protocol.PROTOCOL_HASH, "0.1.0", 77, 2, 2000.0, 29205.0, 50, (4.0, 4.0), 150.0
    )
    assert status == BoardStatus(
        t_board_us=123_456,
        state=BoardState.LIVE,
        seq=9,
        t_received_us=120_000,
        t_applied_us=122_000,
        applied=True,
        saturated=True,
        limited=False,
        fault_code=0,
        deadman_trips=1,
        bad_frames=2,
        late_frames=3,
        measured_um=(1j, 4 + 5j),
        voltage_v=(2 + 3j, 6 + 7j),
    )
    assert time == BoardTime(10**18, 4_000_000_000, 4_000_000_100)
    models = (ModeModel(0.0, 1.0, 2.0, 3 + 4j), ModeModel(5.0, 6.0, 7.0, 8 + 9j))
    assert controller == BoardController("pi_ff", 900.0, 0.25, models)
    assert point == SweepPoint(3, 31, 1, 29205.0, 12.5, (1j, 2 + 3j))
    modes = (ModeSample(1j, 2 + 3j, 4 + 5j, 6.0, 7.0), ModeSample(8 + 9j, 10 + 11j, 12 + 13j, 14.0, 15.0))
    assert sample == TelemetrySample(123_456, 7, BoardState.TOOL, saturated=True, limited=False, modes=modes)
    assert log == BoardLog(4, 2, (LogEntry(1000, 77, 3, 0, 0.5), LogEntry(1001, 77, 4, None, 0.5)))
    assert verdict == BoardVerdict(protocol.MSG_SWEEP, CommandResult.NOT_QUIET)


def test_a_law_of_a_later_firmware_is_read_as_unknown() -> None:
    (controller,) = device.Decoder().feed(frame(protocol.MSG_CONTROLLER, b"\x63" + CONTROLLER[1:]))
    assert controller.law is None


def test_a_board_that_must_not_drive_sends_limits_of_zero() -> None:
    silent = HELLO[:-12] + struct.pack("<f", 0.0) + HELLO[-8:]
    assert hello(silent).v_limit_v == 0.0


@pytest.mark.parametrize("kind", TO_HOST)
def test_every_flipped_bit_is_refused(kind: int) -> None:
    line = frame(kind, TO_HOST[kind])
    for i in range(8 * len(line)):
        damaged = bytearray(line)
        damaged[i // 8] ^= 1 << i % 8
        decoder = device.Decoder()
        assert decoder.feed(bytes(damaged) + b"\0") == ()
        assert sum(decoder.counters.values()) >= 1


@pytest.mark.parametrize("kind", TO_HOST)
def test_every_truncation_is_refused(kind: int) -> None:
    line = frame(kind, TO_HOST[kind])
    for n in range(1, len(line) - 1):
        decoder = device.Decoder()
        assert decoder.feed(line[:n] + b"\0" + line) == decoder.feed(line) != ()
        assert sum(decoder.counters.values()) == 1


@pytest.mark.parametrize(
    ("kind", "payload", "reason"),
    [
        (0x55, b"", "type"),
        (protocol.MSG_TIME, TIME + b"\0", "length"),
        (protocol.MSG_STATUS, STATUS[:-1], "length"),
        (protocol.MSG_STATUS, STATUS[:4] + b"\x04" + STATUS[5:], "value"),
        (protocol.MSG_STATUS, STATUS[:-4] + struct.pack("<f", math.nan), "value"),
        (protocol.MSG_HELLO, HELLO[:-4] + struct.pack("<f", math.inf), "value"),
        (protocol.MSG_HELLO, HELLO[:7] + b"\x07" + HELLO[8:], "value"),
        (protocol.MSG_HELLO, HELLO[:-4], "length"),
        (protocol.MSG_CONTROLLER, CONTROLLER + b"\0", "length"),
        (protocol.MSG_CONTROLLER, CONTROLLER[:-4] + struct.pack("<f", math.nan), "value"),
        (protocol.MSG_SWEEP_POINT, SWEEP_POINT[:4] + b"\x02" + SWEEP_POINT[5:], "value"),
        (protocol.MSG_SWEEP_POINT, struct.pack("<H", 31) + SWEEP_POINT[2:], "value"),
        (protocol.MSG_TELEMETRY, TELEMETRY[:8] + b"\x04" + TELEMETRY[9:], "value"),
        (protocol.MSG_TELEMETRY, TELEMETRY[:-1], "length"),
        (protocol.MSG_LOG, LOG[:-1], "length"),
        (protocol.MSG_LOG, LOG[:1] + b"\x09" + LOG[2:], "value"),
        (protocol.MSG_VERDICT, VERDICT[:1] + b"\x03", "value"),
    ],
)
def test_a_sound_frame_with_senseless_contents_is_counted_by_reason(kind: int, payload: bytes, reason: str) -> None:
    decoder = device.Decoder()
    assert decoder.feed(frame(kind, payload)) == ()
    assert {key: count for key, count in decoder.counters.items() if count} == {reason: 1}


# --- the handshake ----------------------------------------------------------------------------------------------


def hello(payload: bytes = HELLO) -> BoardHello:
    (message,) = device.Decoder().feed(frame(protocol.MSG_HELLO, payload))
    return message


def test_a_later_version_with_a_longer_hello_is_refused_by_its_version() -> None:
    later = struct.pack("<H", protocol.PROTOCOL_VERSION + 1) + HELLO[2:] + b"new fields"
    with pytest.raises(DeviceError, match="protocol version 3, this hapticd 2"):
        device.check_hello(hello(later), modes=2, w_limit_um=(4.0, 4.0))


def test_another_layout_is_refused_by_its_hash() -> None:
    with pytest.raises(DeviceError, match="protocol hash 00000000"):
        device.check_hello(hello(HELLO[:2] + bytes(4) + HELLO[6:]), modes=2, w_limit_um=(4.0, 4.0))


def test_other_modes_and_lower_limits_are_refused() -> None:
    with pytest.raises(DeviceError, match=r"2 modes.* 3"):
        device.check_hello(hello(), modes=3, w_limit_um=(4.0, 4.0, 4.0))
    with pytest.raises(DeviceError, match=r"mode 1 .*5 um.* 4 um"):
        device.check_hello(hello(), modes=2, w_limit_um=(4.0, 5.0))
    with pytest.raises(DeviceError, match=r"mode 0 .*nan"):
        device.check_hello(hello(), modes=2, w_limit_um=(math.nan, 4.0))


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("control_hz", 0.0, "control_hz is 0, not within 500..50000"),
        ("drive_hz", 0.0, "drive_hz is 0, not within 1..1e"),
        ("deadman_ms", 0, "deadman_ms is 0, not within 50..50"),
        ("deadman_ms", 500, "deadman_ms is 500, not within 50..50"),
        ("v_limit_v", 0.0, "v_limit_v is 0, not within"),
    ],
)
def test_a_hello_that_makes_no_sense_is_refused_by_its_field(field: str, value: float, sentence: str) -> None:
    with pytest.raises(DeviceError, match=re.escape(f"The board's HELLO makes no sense: {sentence}")):
        device.check_hello(dataclasses.replace(hello(), **{field: value}), modes=2, w_limit_um=(4.0, 4.0))


def test_a_decoder_reports_which_messages_were_invalid() -> None:
    decoder = device.Decoder()
    decoder.feed(frame(protocol.MSG_STATUS, STATUS))
    assert decoder.invalid_types == set()
    decoder.feed(frame(protocol.MSG_STATUS, STATUS[:-1]) + frame(protocol.MSG_VERDICT, b"\x06\x09"))
    assert decoder.invalid_types == {protocol.MSG_STATUS, protocol.MSG_VERDICT}


def test_a_mode_calibrated_far_from_the_drive_is_refused() -> None:
    near, far = (ModeCalibration(0, f_hz, 500.0, 5.0, 0.0) for f_hz in (29300.0, 34000.0))
    device.check_calibration(hello(), BoardCalibration((near,), 29205.0))
    with pytest.raises(DeviceError, match=r"Mode 0 .*34000 Hz.*29205 Hz"):
        device.check_calibration(hello(), BoardCalibration((near, far), 29205.0))
    device.check_calibration(hello(), BoardCalibration((), 31205.0))
    for drive_hz in (31206.0, 27204.0, math.nan):
        with pytest.raises(DeviceError, match="sets the drive to"):
            device.check_calibration(hello(), BoardCalibration((), drive_hz))


def test_a_status_may_grow_at_its_end() -> None:
    more = protocol.MORE_STATUS.pack(29205.0, 9, 712, 3, 0xFF33)
    for tail, drive_hz, number, refused, refusal, holdable_frac in (
        (b"", 0.0, None, 0, 0, ()),
        (more[:4], 29205.0, None, 0, 0, ()),
        (more[:-8], 29205.0, 9, 712, 3, ()),
        (more + b"of a later version", 29205.0, 9, 712, 3, (0.2, 1.0)),
    ):
        (status,) = device.Decoder().feed(frame(protocol.MSG_STATUS, STATUS + tail))
        found = (status.drive_hz, status.number, status.refused_seq, status.refusal, status.holdable_frac)
        assert found == (drive_hz, number, refused, refusal, holdable_frac)


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7])
def test_a_status_that_ends_within_a_field_is_refused(size: int) -> None:
    decoder = device.Decoder()
    end = protocol.MORE_STATUS.pack(29205.0, 9, 712, 3, 0xFF33)[:size]
    assert list(decoder.feed(frame(protocol.MSG_STATUS, STATUS + end))) == []
    assert decoder.invalid_types == {protocol.MSG_STATUS}


def test_a_board_of_another_hash_is_driven_if_it_understands_all_commands() -> None:
    later = dataclasses.replace(hello(), protocol_hash=1, commands=device.ALL_COMMANDS | 1 << 31)
    device.check_hello(later, modes=2, w_limit_um=(4.0, 4.0))
    without_wiring = device.ALL_COMMANDS & ~(1 << protocol.MSG_SET_WIRING)
    with pytest.raises(DeviceError, match="protocol hash 00000001"):
        device.check_hello(dataclasses.replace(later, commands=without_wiring), modes=2, w_limit_um=(4.0, 4.0))
    with pytest.raises(DeviceError, match="protocol version 3"):
        device.check_hello(dataclasses.replace(later, protocol_version=3), modes=2, w_limit_um=(4.0, 4.0))
