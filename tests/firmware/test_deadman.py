"""The board must fall silent by itself: when the host does, and when the plate makes no sense."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from carrier_board import fake_measurement

from hapticd.board_protocol import BoardState, HelloRequest, Keepalive
from hapticd.board_values import BoardStatus, SetController
from hapticd.sim.board.board import FLAG_DEADMAN, FLAG_LIVE
from hapticd.wire import device

from .bench import Bench


def live(flags: np.ndarray) -> np.ndarray:
    return (flags & FLAG_LIVE) != 0


@pytest.mark.parametrize("t_start_us", [0, 2**32 - 30_000, 2**31 - 30_000])
def test_a_silent_host_leads_to_a_silent_plate_within_60_ms(t_start_us: int) -> None:
    bench = Bench(t_start_us=t_start_us)
    bench.arm(2 + 0j, 1j)
    bench.say(bench.constant(2 + 0j, 1j))
    trace = bench.run(160)
    ticks_ms = 0.5 * (1 + np.arange(160))
    assert live(trace.flags)[ticks_ms <= 50].all()
    assert not live(trace.flags)[ticks_ms > 50].any()
    assert (np.abs(trace.voltage_v[ticks_ms <= 50]) > 10).all()
    assert (trace.voltage_v[ticks_ms > 60.5] == 0).all()
    falling = np.abs(trace.reference_um[(ticks_ms > 51) & (ticks_ms < 60), 0])
    assert (np.diff(falling) < 0).all()
    assert (trace.flags[ticks_ms > 50] & FLAG_DEADMAN != 0).all()
    assert bench.status().deadman_trips == 1


def test_the_voltage_ramps_down_even_if_the_sensors_lie(bench: Bench) -> None:
    bench.arm(1 + 0j, 0j)
    fake_measurement(bench.board, np.array([-3.0, 3.0]))
    trace = bench.run(160)
    bound = bench.config.v_limit_v * np.clip(1 - (np.arange(160) - 79) / 20, 0, 1)  # armed 20 ticks ago
    assert (np.abs(trace.voltage_v).max(axis=1) <= bound + 1e-3).all()


def test_keepalives_that_outlive_their_planner_do_not_hold_the_plate(bench: Bench) -> None:
    """A reference that moves the plate holds for 10 s; none at all for ever."""
    bench.arm(2 + 0j, 1j)
    trace = bench.hold(2000 * 11)
    driven_s = np.flatnonzero(np.abs(trace.voltage_v).max(axis=1))[-1] / 2000
    assert 9.9 < driven_s < 10.1
    bench.arm(0j, 0j)
    assert live(bench.hold(2000 * 11).flags).all()


def test_keepalives_of_another_reference_do_not(bench: Bench) -> None:
    bench.arm(2 + 0j, 0j)
    for _ in range(8):
        bench.say(device.encode(Keepalive(bench.seq + 1)))
        bench.run(20)
    status = bench.status()
    assert status.state is BoardState.QUIET
    assert status.late_frames == 8


@pytest.mark.parametrize(
    "between",
    [
        lambda bench: bench.say(b"\x05noise\x00"),
        lambda bench: bench.say(device.encode(SetController("pi")).replace(b"\x02\x06", b"\x02\x07")),
        lambda bench: bench.say(bench.polyline((0, (1 + 0j, 0j)), t_apply_us=bench.board.t_us - 60_000)),
        lambda bench: bench.run(102),
    ],
    ids=["noise", "a frame of unknown type", "a stale reference", "a gap"],
)
def test_only_three_references_in_a_row_start_the_drive(bench: Bench, between: Callable[[Bench], object]) -> None:
    bench.run(200)
    for _ in range(2):
        bench.say(bench.constant(1 + 0j, 0j))
    bench.say(device.encode(Keepalive(bench.seq)))
    assert not live(bench.run(20).flags).any()
    between(bench)
    bench.say(bench.constant(1 + 0j, 0j))
    assert not live(bench.run(1).flags).any()
    for _ in range(2):
        bench.say(bench.constant(1 + 0j, 0j))
    assert live(bench.run(1).flags).all()


def test_after_a_trip_three_fresh_references_ramp_the_drive_in_again(bench: Bench) -> None:
    bench.arm(2 + 0j, 0j)
    bench.run(200)
    bench.say(device.encode(Keepalive(bench.seq)))
    assert not live(bench.run(20).flags).any()
    for _ in range(3):
        bench.say(bench.constant(2 + 0j, 0j))
    trace = bench.run(60)
    assert live(trace.flags).all()
    assert (np.diff(np.abs(trace.reference_um[:20, 0])) > 0).all()
    assert abs(trace.plate_um[-1, 0] - 2) < 0.01
    assert not (trace.flags & FLAG_DEADMAN).any()


def test_references_that_come_back_during_the_ramp_wait_for_its_end(bench: Bench) -> None:
    bench.arm(2 + 0j, 0j)
    bench.run(90)
    for _ in range(3):
        bench.say(bench.constant(-2 + 0j, 0j))
    trace = bench.run(40)
    silent = np.flatnonzero((trace.voltage_v == 0).all(axis=1))
    assert len(silent) > 0
    assert not live(trace.flags[: silent[0]]).any()
    assert (trace.reference_um[: silent[0], 0].real >= 0).all()
    assert live(trace.flags[silent[-1] + 1 :]).all()


@pytest.mark.parametrize(
    ("latch", "ticks", "state", "fault"),
    [(False, 200, BoardState.QUIET, 0), (True, 200, BoardState.FAULT, 5), (True, 10_100, BoardState.QUIET, 0)],
)
def test_three_trips_latch_within_ten_seconds_if_asked_to(
    latch: bool, ticks: int, state: BoardState, fault: int
) -> None:
    bench = Bench(latch_repeated_trips=latch)
    for _ in range(3):
        bench.arm(1 + 0j, 0j)
        bench.run(ticks)
    last = bench.received(BoardStatus)[-1]
    assert (last.state, last.deadman_trips, last.fault_code) == (state, 3, fault)


@pytest.mark.parametrize(
    ("measured_um", "within_ticks", "fault"),
    [
        *[((1.0, complex(0, value)), 0, 1) for value in (math.nan, math.inf, -math.inf)],
        ((3e38, 0.0), 0, 2),
        ((6.1, 0.0), 7, 3),  # its turn is every other tick
        ((0.0, 0.0), 240, 4),
    ],
    ids=str,
)
def test_a_measurement_that_makes_no_sense_is_silence_in_time(
    bench: Bench, measured_um: tuple[complex, complex], within_ticks: int, fault: int
) -> None:
    """In the same tick if it, or the voltage that the gain makes of it, is not finite; else once it is sure."""
    bench.arm(2 + 0j, 0j)
    fake_measurement(bench.board, np.array(measured_um))
    trace = bench.hold(within_ticks + 40)
    assert (trace.voltage_v[within_ticks:] == 0).all()
    assert (np.abs(trace.voltage_v[: within_ticks - 1, 0]) > 0).any() or within_ticks == 0
    last = bench.received(BoardStatus)[-1]
    assert (last.state, last.fault_code) == (BoardState.FAULT, fault)


def test_a_fault_stays_until_it_is_cleared(bench: Bench) -> None:
    bench.arm(1 + 0j, 0j)
    fake_measurement(bench.board, np.array([math.nan, 0]))
    bench.run(1)
    fake_measurement(bench.board, None)
    bench.say(device.encode(HelloRequest()))
    bench.arm(1 + 0j, 0j)
    assert not live(bench.hold(100).flags).any()
    assert bench.status().state is BoardState.QUIET
    assert not live(bench.run(1).flags).any()
    bench.arm(1 + 0j, 0j)
    assert live(bench.run(1).flags).all()


def test_a_new_session_starts_from_silence_and_any_sequence_number(bench: Bench) -> None:
    bench.arm(2 + 0j, 0j)
    bench.say(device.encode(HelloRequest()))
    trace = bench.run(1)
    assert (trace.voltage_v == 0).all()
    assert not live(trace.flags).any()
    bench.seq = 40_000 - 3
    bench.arm(1 + 0j, 0j)
    assert bench.status().seq == 40_000
