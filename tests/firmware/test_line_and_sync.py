"""The line's speed and the sync output: set by the host, bounded by the board, undone by silence."""

from __future__ import annotations

import struct

import numpy as np

from hapticd import board_protocol as protocol
from hapticd.board_protocol import CommandResult, HelloRequest, SetBaud, TimeRequest
from hapticd.board_values import BoardHello, BoardStatus
from hapticd.sim.board.board import FLAG_SYNC
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device
from hapticd.wire.framing import FrameSplitter, encode_frame

from .bench import Bench, of_kind

FAST_BAUD, TICK_US = 3_000_000, 500
ONE_UM = SafeDrive(0, (Knot(0, (1 + 0j, 0j)),), LimitReason.NONE)


def test_a_quiet_board_takes_a_speed_up_to_its_fastest() -> None:
    bench = Bench(baud_max=FAST_BAUD)
    (hello,) = bench.say(device.encode(HelloRequest()))
    assert (hello.baud_max, bench.board.baud) == (FAST_BAUD, 0)
    assert bench.verdict(SetBaud(FAST_BAUD + 1)) is CommandResult.OUT_OF_RANGE
    assert bench.verdict(SetBaud(FAST_BAUD)) is CommandResult.DONE
    assert bench.board.baud == FAST_BAUD
    bench.arm()
    assert bench.verdict(SetBaud(921600)) is CommandResult.NOT_QUIET
    assert bench.board.baud == FAST_BAUD
    assert Bench().verdict(SetBaud(921600)) is CommandResult.OUT_OF_RANGE, "it has one speed"


def test_without_a_valid_frame_the_board_returns_to_its_first_speed() -> None:
    bench = Bench(baud_max=FAST_BAUD)
    bench.verdict(SetBaud(FAST_BAUD))
    for _ in range(3):  # each in time
        bench.run(2300)
        assert bench.board.baud == FAST_BAUD
        bench.say(device.encode(TimeRequest(1)))
    for _ in range(12):
        bench.say(b"\x55" * 30 + b"\0")  # what another speed looks like
        bench.run(201)
    assert bench.board.baud == 0


def pulsed(bench: Bench) -> None:
    bench.seq += 1
    bench.say(device.encode_reference(bench.seq, ONE_UM, bench.board.t_us, has_pulse=True))


def rises(flags: np.ndarray) -> list[int]:
    high = (flags & FLAG_SYNC) != 0
    return np.flatnonzero(np.diff(high, prepend=False) & high).tolist()


def test_the_sync_output_is_high_for_5_ms_from_when_the_reference_takes_effect(bench: Bench) -> None:
    bench.arm()
    bench.messages.clear()
    pulsed(bench)
    trace = bench.run(40)
    assert rises(trace.flags) == [0]
    assert np.count_nonzero(trace.flags & FLAG_SYNC) * TICK_US == 5000
    applied = [status for status in bench.received(BoardStatus) if status.applied]
    assert [m.pulsed for m in applied] == [True]
    assert applied[0].seq == bench.seq


def test_pulses_come_20_ms_apart_at_least(bench: Bench) -> None:
    bench.arm()
    flags = []
    for _ in range(12):  # each 4 ms
        pulsed(bench)
        flags.append(bench.run(8).flags)
    starts = rises(np.concatenate(flags))
    assert (np.diff(starts) * TICK_US >= 20_000).all()
    assert len(starts) == 3


def hello_of(payload: bytes) -> list[BoardHello]:
    return of_kind(BoardHello, device.Decoder().feed(encode_frame(payload)))


def test_a_hello_may_lack_its_last_fields_and_may_have_more() -> None:
    bench = Bench(baud_max=FAST_BAUD, image_crc=0x1234ABCD)
    bench.board.receive(device.encode(HelloRequest()))
    (payload,) = FrameSplitter(512).feed(bench.board.transmit())
    (whole,) = hello_of(payload)
    assert (whole.image_crc, whole.baud_max, whole.has_sync) == (0x1234ABCD, FAST_BAUD, True)
    assert hello_of(payload + struct.pack("<f", 1.0)) == [whole]
    (short,) = hello_of(payload[: -protocol.MORE_HELLO.size])
    assert (short.image_crc, short.baud_max, short.has_sync) == (0, 0, False)
    assert short.w_limit_um == whole.w_limit_um
