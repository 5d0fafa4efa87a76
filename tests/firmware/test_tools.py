"""Open loop at the bench: what sweep, raw voltage, telemetry, models and the log do, and what ends them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from carrier_board import fake_measurement

from hapticd import board_protocol as protocol
from hapticd.board_protocol import (
    BoardState,
    BoardVerdict,
    CommandResult,
    HelloRequest,
    Keepalive,
    RawVoltage,
    SetTelemetry,
    Stop,
    Sweep,
)
from hapticd.board_values import (
    SetController,
    SweepPoint,
    TelemetrySample,
)
from hapticd.sim.board.board import RESET_POWER
from hapticd.wire.commands import encode
from hapticd.wire.framing import encode_frame

from .bench import Bench, untouched

SWEEP = Sweep(0, 29150.0, 29250.0, points=11, dwell_ms=20, voltage_v=15.0)
each_tool = pytest.mark.parametrize("command", [SWEEP, RawVoltage(0, 15 + 0j, 1000)], ids=["sweep", "raw voltage"])
RAMP_TICKS = 20


def test_a_sweep_drives_one_amplifier_ramps_in_and_out_and_reports_each_frequency(bench: Bench) -> None:
    assert bench.verdict(SWEEP) is CommandResult.DONE
    assert bench.status().state is BoardState.TOOL
    bench.seq = 4711  # KEEPALIVE of any reference keeps a tool up
    voltage_v = bench.hold(11 * 40 + 3 * RAMP_TICKS).voltage_v
    assert (voltage_v[:, 1] == 0).all()
    assert np.abs(voltage_v[:, 0].imag).max() == 0
    assert np.abs(voltage_v[15:-60, 0]).max() == 15
    steps_v = np.abs(np.diff(voltage_v[:, 0].real, prepend=0.0))
    assert steps_v.max() <= protocol.RAW_LIMIT_FRAC * 150 / RAMP_TICKS * 1.0001
    assert voltage_v[-1, 0] == 0
    assert bench.status().state is BoardState.QUIET
    found = bench.received(SweepPoint)
    assert [(point.index, point.points, point.mode) for point in found] == [(i, 11, 0) for i in range(11)]
    np.testing.assert_allclose([point.frequency_hz for point in found], np.linspace(29150, 29250, 11), atol=0.005)
    assert {point.voltage_v for point in found} == {15.0}


def test_a_point_is_the_mean_over_the_second_half_of_its_dwell(bench: Bench) -> None:
    """The sensors say another value in each tick of the dwell."""
    bench.say(encode(Sweep(0, 29205.0, 29205.0, points=1, dwell_ms=5, voltage_v=1.5)))
    bench.run(1)  # 1.5 V a tick: the voltage is there
    for i in range(10):
        fake_measurement(bench.board, np.array([0.1 * i + 0j, -0.1j * i]))
        bench.run(1)
    (point,) = bench.received(SweepPoint)
    np.testing.assert_allclose(point.measured_um, [0.7, -0.7j], rtol=1e-6)  # of ticks 5 to 9


SOUND = {"mode": 0, "start_hz": 29190.0, "stop_hz": 29220.0, "points": 3, "dwell_ms": 2, "voltage_v": 30.0}
WRONG = {
    "mode": [2],
    "start_hz": [27204.0, math.nan],
    "stop_hz": [31206.0, math.inf],
    "points": [0, 2002],
    "dwell_ms": [0, 1001],
    "voltage_v": [30.01, 0.0, math.nan],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in WRONG.items() for value in values])
def test_a_sweep_beyond_the_boards_own_bounds_does_not_begin(bench: Bench, name: str, value: float) -> None:
    """In a frame that the host would not have encoded."""
    payload = protocol.SWEEP.pack(*(SOUND | {name: value}).values())
    answers = bench.say(encode_frame(bytes((protocol.MSG_SWEEP,)) + payload))
    assert answers == (BoardVerdict(protocol.MSG_SWEEP, CommandResult.OUT_OF_RANGE),)
    assert (bench.run(40).voltage_v == 0).all()
    assert bench.verdict(Sweep(**SOUND)) is CommandResult.DONE


@pytest.mark.parametrize(
    "raw", [RawVoltage(2, 1j, 10), RawVoltage(0, 22 + 22j, 10), RawVoltage(0, complex(0, 1e4), 10)]
)
def test_a_raw_voltage_above_its_limit_does_not_begin(bench: Bench, raw: RawVoltage) -> None:
    assert bench.verdict(raw) is CommandResult.OUT_OF_RANGE
    assert (bench.run(10).voltage_v == 0).all()


def test_a_raw_voltage_stands_for_its_time_and_ramps_out(bench: Bench) -> None:
    assert bench.verdict(RawVoltage(1, 12 - 16j, duration_ms=30)) is CommandResult.DONE
    bench.seq = 4711
    voltage_v = bench.hold(100).voltage_v
    assert (voltage_v[:, 0] == 0).all()
    assert (voltage_v[14:58, 1] == 12 - 16j).all()
    np.testing.assert_allclose(np.abs(voltage_v[:13, 1]), 1.5 * np.arange(1, 14), rtol=1e-6)  # 30 V in 20 ticks
    assert (voltage_v[60 + 14 :] == 0).all()
    assert bench.status().state is BoardState.QUIET


@each_tool
def test_a_host_that_falls_silent_ends_a_tool_within_60_ms(bench: Bench, command: Any) -> None:
    bench.say(encode(command))
    voltage_v = bench.run(140).voltage_v
    ticks_ms = 0.5 * (1 + np.arange(140))
    assert (np.abs(voltage_v[(ticks_ms > 6) & (ticks_ms <= 50), 0]) == 15).all()
    assert (voltage_v[ticks_ms > 60] == 0).all()
    assert bench.status().state is BoardState.QUIET
    (entry,) = bench.log().entries
    assert (entry.code, entry.mode, entry.value) == (65, 0, 15.0)


@each_tool
def test_stop_ramps_a_tool_out_and_a_greeting_ends_it_at_once(bench: Bench, command: Any) -> None:
    bench.say(encode(command))
    bench.run(20)
    assert bench.verdict(Stop()) is CommandResult.DONE
    voltage_v = np.abs(bench.run(20).voltage_v[:, 0])
    assert (np.diff(voltage_v[:10]) < 0).all()
    assert voltage_v[-1] == 0
    bench.say(encode(command))
    bench.run(20)
    bench.say(encode(HelloRequest()))
    assert (bench.run(20).voltage_v == 0).all()
    assert bench.status().state is BoardState.QUIET


@pytest.mark.parametrize(
    ("measured_um", "ticks", "fault"), [((6.5, 0.0), 8, (3, 0)), ((0.0, complex(math.nan)), 0, (1, 1))]
)
@each_tool
def test_a_measurement_that_makes_no_sense_ends_a_tool_as_a_fault(
    bench: Bench, command: Any, measured_um: tuple[complex, complex], ticks: int, fault: tuple[int, int]
) -> None:
    bench.say(encode(command))
    bench.run(20)
    fake_measurement(bench.board, np.array(measured_um, complex))
    assert (bench.hold(20).voltage_v[ticks:] == 0).all()
    assert bench.status().state is BoardState.QUIET  # asking clears it
    (entry,) = bench.log().entries
    assert (entry.code, entry.mode) == fault


def test_references_neither_reach_the_plate_during_a_sweep_nor_start_it_afterwards(bench: Bench) -> None:
    bench.say(encode(SWEEP))
    for _ in range(11 * 40 + RAMP_TICKS // 2):
        bench.say(bench.constant(1 + 0j, 1j))
        bench.say(encode(Keepalive(0)))
        assert (bench.run(1).reference_um == 0).all()
    assert bench.status().state is BoardState.TOOL  # on its way out
    trace = bench.run(2 * RAMP_TICKS)
    assert (trace.reference_um == 0).all()
    assert (trace.voltage_v[RAMP_TICKS:] == 0).all()


@each_tool
def test_only_a_quiet_board_takes_a_tool(bench: Bench, command: Any) -> None:
    bench.arm(1 + 0j, 0j)
    assert bench.verdict(command) is CommandResult.NOT_QUIET
    assert bench.status().state is BoardState.LIVE
    bench.run(90)
    assert bench.verdict(command) is CommandResult.NOT_QUIET  # its ramp to silence is not over
    bench.run(40)
    assert bench.verdict(command) is CommandResult.DONE
    assert bench.verdict(SWEEP) is CommandResult.NOT_QUIET
    assert bench.verdict(SetController("pi")) is CommandResult.NOT_QUIET
    fake_measurement(bench.board, np.full(2, math.nan, dtype=np.complex128))
    bench.run(1)
    assert bench.verdict(command) is CommandResult.NOT_QUIET


@pytest.mark.parametrize(("asked_hz", "ticks"), [(2000, 1), (5000, 1), (1999, 2), (1000, 2), (999, 3), (1, 2000)])
def test_telemetry_comes_at_the_highest_divisor_of_the_control_rate_within_the_asked(
    bench: Bench, asked_hz: int, ticks: int
) -> None:
    assert bench.verdict(SetTelemetry(asked_hz)) is CommandResult.DONE
    bench.run(2 * ticks)
    assert [sample.t_board_us for sample in bench.received(TelemetrySample)] == [500 * ticks, 1000 * ticks]


def test_a_line_too_slow_for_telemetry_loses_the_oldest_samples_and_counts_them(bench: Bench) -> None:
    bench.say(encode(SetTelemetry(2000)))
    untouched(bench.board, 100)
    while bench.listen():
        pass
    received = bench.received(TelemetrySample)
    assert [sample.t_board_us for sample in received] == [500 * tick for tick in range(85, 101)]
    assert {sample.dropped for sample in received} == {84}


def test_the_log_keeps_the_last_eight_events_and_counts_all(bench: Bench) -> None:
    for _ in range(10):
        bench.arm(1 + 0j, 0j)
        bench.run(160)
    fake_measurement(bench.board, np.full(2, math.nan, dtype=np.complex128))
    bench.run(1)
    found = bench.log()
    assert (found.reset_cause, found.events) == (RESET_POWER, 11)
    assert [entry.code for entry in found.entries] == [64] * 7 + [1]
    assert [entry.boot_id for entry in found.entries] == [0x1234] * 8
    times_us = [entry.t_board_us for entry in found.entries]
    assert times_us == sorted(times_us)
