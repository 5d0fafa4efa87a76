"""What the board takes from the line and what it says, byte for byte."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd import board_protocol as protocol
from hapticd.board_protocol import (
    BoardState,
    BoardTime,
    BoardVerdict,
    ClearFault,
    CommandResult,
    ControllerRequest,
    HelloRequest,
    Keepalive,
    LogRequest,
    RawVoltage,
    SetTelemetry,
    Stop,
    Sweep,
    TimeRequest,
)
from hapticd.board_values import BoardController, BoardHello, BoardLog, BoardStatus, ModeModel, SetController, SetModel
from hapticd.sim.board import firmware
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import board_messages, device
from hapticd.wire.framing import FrameSplitter, encode_frame

from .bench import Bench, of_kind

EXAMPLE_DRIVE = SafeDrive(0, (Knot(0, (1 + 0j, -0.5 + 0j)), Knot(10_000_000, (1.25 + 0j, 0j))), LimitReason.NONE)
TO_BOARD = {
    "HELLO_REQUEST": device.encode(HelloRequest()),
    "REFERENCE": device.encode_reference(7, EXAMPLE_DRIVE, 1000),
    "KEEPALIVE": device.encode(Keepalive(7)),
    "TIME_REQUEST": device.encode(TimeRequest(123_456_789)),
    "CLEAR_FAULT": device.encode(ClearFault()),
    "SET_CONTROLLER": device.encode(SetController("pi")),
    "SET_MODEL": device.encode(SetModel(1, ModeModel(180.0, 60.0, 5.0, 0.6 + 0.8j))),
    "CONTROLLER_REQUEST": device.encode(ControllerRequest()),
    "SWEEP": device.encode(Sweep(0, 29190.0, 29220.0, 31, 40, 20.0)),
    "RAW_VOLTAGE": device.encode(RawVoltage(1, 3 - 4j, 100)),
    "SET_TELEMETRY": device.encode(SetTelemetry(500)),
    "LOG_REQUEST": device.encode(LogRequest()),
    "STOP": device.encode(Stop()),
}


def test_a_buffer_for_the_longest_message_gets_whole_frames_one_by_one(bench: Bench) -> None:
    """The most urgent first: the clock's exchange and the state do not wait for what a person asked."""
    asked = ("HELLO_REQUEST", "LOG_REQUEST", "CONTROLLER_REQUEST", "STOP", "CLEAR_FAULT", "TIME_REQUEST")
    bench.board.receive(b"".join(TO_BOARD[name] for name in asked))
    library, handle = firmware.load(2), bench.board._board
    longest = 1 + protocol.LOG.size + protocol.LOG_ENTRIES * protocol.LOG_ENTRY.size + 2
    decoder, buffer = board_messages.BoardDecoder(), ctypes.create_string_buffer(longest + 2)
    kinds = []
    for _ in range(8):
        n = library.hd_board_transmit(handle, buffer, len(buffer), 0)
        kinds += [type(message) for message in decoder.feed(buffer.raw[:n])]
    assert kinds == [BoardTime, BoardHello, BoardStatus, BoardVerdict, BoardController, BoardLog]
    assert not any(decoder.counters.values())


@pytest.mark.parametrize("name", TO_BOARD)
def test_every_flipped_bit_is_refused_by_the_board(bench: Bench, name: str) -> None:
    line = TO_BOARD[name]
    before = bench.status()
    for i in range(8 * len(line)):
        damaged = bytearray(line)
        damaged[i // 8] ^= 1 << i % 8
        assert bench.say(bytes(damaged) + b"\0") == ()
        status = bench.status()
        assert status.bad_frames > before.bad_frames
        assert (status.seq, status.t_received_us, status.late_frames) == (0, 0, 0)
        before = status


@pytest.mark.parametrize("modes", [2, 3, 8])
def test_the_longest_frame_is_taken_and_followed(modes: int) -> None:
    detuning_rad_s = (-60.0, 60.0, *(0.0,) * (modes - 2))
    nominal = {"decay_1_s": (183.0,) * modes, "detuning_rad_s": detuning_rad_s, "gain_um_per_v_s": (5.0,) * modes}
    bench = Bench(w_limit_um=(4.0,) * modes, **nominal)
    bench.arm()
    rng = np.random.default_rng(1)
    knots = [(10 * i, rng.uniform(0.1, 1, modes) + 1j * rng.uniform(0.1, 1, modes)) for i in range(24)]
    line = bench.polyline(*knots)
    assert len(line) > 254  # more than one COBS block, for there is hardly a zero in it
    bench.say(line)
    assert bench.status().seq == bench.seq
    np.testing.assert_allclose(bench.hold(500).plate_um[-1], knots[-1][1], atol=1e-4)


def verdicts(bench: Bench, kind: int, *payloads: bytes) -> list[CommandResult]:
    answers = [one for payload in payloads for one in bench.say(encode_frame(bytes((kind,)) + payload))]
    found = of_kind(BoardVerdict, answers)
    assert all(answer.request == kind for answer in found)
    return [answer.verdict for answer in found]


GAINS, MODEL = (1, 900.0, 0.0025), (1, 180.0, 60.0, 5.0, 0.6, 0.8)
WRONG_GAINS = ((0, 9), (1, 20001.0), (1, -900.0), (1, math.nan), (2, math.inf), (2, 0.9e-4))
WRONG_MODEL = (
    *((0, value) for value in (2, 255)),
    *((1, value) for value in (0.5, 10001.0, -180.0, math.nan, math.inf)),
    *((2, value) for value in (20001.0, -20001.0, math.nan, -math.inf)),
    *((3, value) for value in (0.0, 1e-4, 10001.0, math.nan)),
    *((4, value) for value in (0.0, 0.603, math.nan, 1e30)),
    *((5, value) for value in (0.0, 0.797, -math.inf)),
)


@pytest.mark.parametrize(
    ("name", "sound", "wrong"), [("SET_CONTROLLER", GAINS, WRONG_GAINS), ("SET_MODEL", MODEL, WRONG_MODEL)]
)
def test_gains_or_a_model_with_one_figure_out_of_bounds_are_refused_whole(
    bench: Bench, name: str, sound: tuple[float, ...], wrong: tuple[tuple[int, float], ...]
) -> None:
    before = bench.say(device.encode(ControllerRequest()))
    kind, layout = getattr(protocol, f"MSG_{name}"), getattr(protocol, name)
    for place, value in wrong:
        payload = layout.pack(*sound[:place], value, *sound[place + 1 :])
        assert verdicts(bench, kind, payload) == [CommandResult.OUT_OF_RANGE], (place, value)
    assert bench.say(device.encode(ControllerRequest())) == before
    assert verdicts(bench, kind, layout.pack(*sound)) == [CommandResult.DONE]
    assert bench.say(device.encode(ControllerRequest())) != before


def test_a_refusal_is_not_hidden_by_a_later_success(bench: Bench) -> None:
    for law in (9, 1):
        payload = protocol.SET_CONTROLLER.pack(law, 0.0, 0.0)
        bench.board.receive(encode_frame(bytes((protocol.MSG_SET_CONTROLLER,)) + payload))
    assert bench.listen() == (BoardVerdict(protocol.MSG_SET_CONTROLLER, CommandResult.OUT_OF_RANGE),)


@given(st.sampled_from(sorted(TO_BOARD)), st.binary(max_size=60), st.integers(0, 400))
def test_one_frame_after_any_noise_the_board_understands_again(name: str, noise: bytes, cut: int) -> None:
    """Whatever was on the line before, even half a frame, costs at most the frame it runs into."""
    board = Bench().board
    board.receive(noise + TO_BOARD[name][:cut] + TO_BOARD["KEEPALIVE"])
    board.receive(TO_BOARD["HELLO_REQUEST"])
    assert of_kind(BoardHello, device.Decoder().feed(board.transmit()))


@pytest.mark.parametrize(
    ("reason", "late_us", "edit"),
    [
        (1, 0, lambda payload: payload[:6] + b"\x02" + payload[7:]),  # two knots, but one is there
        (1, 0, lambda payload: payload[:-4] + b"\0\0\xc0\x7f"),  # not a number
        (2, -1_500_000, bytes),
        (3, 60_000, bytes),
        (4, 0, lambda payload: b"\x01\0" + payload[2:]),  # the first one again
    ],
    ids=["knots", "nan", "ahead", "stale", "order"],
)
def test_a_reference_that_is_not_taken_is_named_with_its_reason(
    bench: Bench, reason: int, late_us: int, edit: Callable[[bytes], bytes]
) -> None:
    bench.run(200)  # 0.1 s
    bench.say(bench.constant(0j, 0j))
    assert (bench.status().refused_seq, bench.status().refusal) == (0, 0)
    (typed,) = FrameSplitter(512).feed(bench.polyline((0.0, (1 + 0j, 0j)), t_apply_us=bench.board.t_us - late_us))
    payload = edit(typed[1:])
    bench.say(encode_frame(typed[:1] + payload))
    status = bench.status()
    assert (status.refused_seq, status.refusal) == (payload[0], reason)
    assert bench.status().refusal == reason, "one lost STATUS loses no reason"
    assert reason in protocol.REFUSALS
    bench.say(device.encode(HelloRequest()))
    assert bench.status().refusal == 0


def test_a_reference_during_a_tool_is_named_with_its_reason(bench: Bench) -> None:
    bench.say(device.encode(RawVoltage(0, 3 + 0j, 100)))
    bench.run(2)
    bench.say(bench.constant(0j, 0j))
    assert (bench.status().refused_seq, bench.status().refusal) == (1, 5)


def test_a_change_of_controller_ramps_the_drive_in_anew(bench: Bench) -> None:
    bench.arm(2 + 0j, 0j)
    bench.hold(40)
    bench.say(device.encode(SetController("pi")))
    trace = bench.hold(200)
    assert abs(trace.reference_um[0, 0]) == pytest.approx(0.1)
    assert abs(trace.plate_um[-1, 0] - 2) < 0.01
    assert bench.status().state is BoardState.LIVE
