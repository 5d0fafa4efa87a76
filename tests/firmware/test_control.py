"""How well the plate follows: the bars that each law must meet, on nominal and other plates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.bench.firmware import worst_response
from hapticd.board_protocol import CommandResult
from hapticd.board_values import BoardStatus, SetController
from hapticd.config.sections import LAW_DELAY_MS
from hapticd.sim.board.board import FLAG_LIVE, Board, BoardConfig
from hapticd.sim.board.board import reference_decay_1_s as decay_1_s
from hapticd.sim.board.closed_loop import (
    LIMIT_V,
    NOISE_UM,
    Law,
    LoopPlate,
    follow,
    measure,
    settling_ms,
    stepped,
)
from hapticd.sim.score import rms
from hapticd.values import ComplexArray
from hapticd.wire import device

from .bench import Bench, constantly, nominal_plate, of_kind, step_trace

DEADBEAT, PI_FF, PI = Law("deadbeat"), Law("pi_ff"), Law("pi")
FAST = Law("deadbeat", 5000.0)
LAWS = (DEADBEAT, FAST, PI_FF, PI)


@pytest.mark.parametrize(
    ("law", "amplitude_um", "most_ms"), [(DEADBEAT, 0.4, 1.5), (DEADBEAT, 2.0, 4.0), (FAST, 0.4, 0.9), (FAST, 2.0, 3.9)]
)
def test_the_default_law_settles_near_the_voltage_s_bound(law: Law, amplitude_um: float, most_ms: float) -> None:
    found = measure(law.respond(LoopPlate(), amplitude_um), amplitude_um, law.tick_ms)
    assert LoopPlate().bound_ms(amplitude_um) < found.settling_ms <= most_ms
    assert found.overshoot_frac <= 0.02
    assert found.cross_axis_frac <= 0.1


@pytest.mark.parametrize("law", [DEADBEAT, FAST], ids=str)
def test_the_default_law_settles_in_every_corner_of_drift_and_damping(law: Law) -> None:
    worst = worst_response(law, 2.0)
    assert worst.settling_ms <= 7.0
    assert worst.overshoot_frac <= 0.06
    assert worst_response(PI, 2.0).settling_ms > 15.0


def coupling(law: Law, noise_um: float = 0.0) -> tuple[float, float]:
    """Peak of the other mode in um, and its ms above 20 nm, while one steps from rest to 1 um under a new finger.

    The finger couples both modes by 591 1/s; the board has learned nothing of it.
    """
    ticks, one = law.phase_ticks, np.array([1.0 + 0j, 0.0])
    touch = np.full((2 * ticks, 1, 2), 0.9), np.full((2 * ticks, 1), 730.0)
    board = law.board(LoopPlate(), noise_um=noise_um)
    other_um = np.abs(follow(board, stepped(0 * one, one), 2 * ticks, ticks // 10, touch).plate_um[:, 1])
    return float(other_um.max()), float(np.count_nonzero(other_um > 0.02)) * law.tick_ms


def test_at_5_khz_a_finger_that_couples_the_modes_lets_little_through() -> None:
    """A first step at full voltage, with and without noise of the sensors: 96 nm and 4.2 ms if nothing is learned."""
    for noise_um in (0.0, NOISE_UM):
        coupled_um, coupled_ms = coupling(FAST, noise_um)
        assert coupled_um <= 0.04
        assert coupled_ms <= 1.0
    assert coupling(DEADBEAT)[0] <= 0.18


@pytest.mark.parametrize("law", [DEADBEAT, FAST], ids=str)
def test_a_finger_that_lands_is_made_good_within_4_ms(law: Law) -> None:
    found = measure(law.respond(LoopPlate(), 2.0), 2.0, law.tick_ms)
    assert 0.02 < found.dip_frac < 0.07
    assert found.recovery_ms <= 4.0


def sinusoid_error_um(law: Law, f_hz: float, delay_ms: float) -> float:
    """RMS distance from sinusoids of 3 um `delay_ms` ago, sent as polylines of 3 ms knots 90 times a second."""

    def amplitudes(t_s: float) -> ComplexArray:
        return 3 * np.array([np.sin(2 * np.pi * f_hz * t_s), np.cos(1.6 * np.pi * f_hz * t_s)]) + 0j

    def knots(t_s: float) -> list[tuple[float, ComplexArray]]:
        return [(ms, amplitudes(t_s + ms * 1e-3)) for ms in range(0, 18, 3)]

    trace = follow(law.board(LoopPlate()), knots, round(0.8 * law.control_hz), round(0.011 * law.control_hz))
    ticks = np.arange(law.phase_ticks, len(trace) - law.phase_ticks)
    return rms(trace.plate_um[ticks] - trace.reference_um[ticks - round(delay_ms / law.tick_ms)])


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("f_hz", [2.0, 10.0, 15.0])
def test_a_moving_reference_is_followed_with_the_delay_that_the_daemon_counts_on(law: Law, f_hz: float) -> None:
    delay_ms = LAW_DELAY_MS[law.controller]
    error_um = sinusoid_error_um(law, f_hz, delay_ms)
    assert error_um < (0.002 if delay_ms == 0.0 else 0.1)
    assert all(sinusoid_error_um(law, f_hz, delay_ms + other_ms) > error_um for other_ms in (-0.5, 0.5))


@pytest.mark.parametrize("law", [DEADBEAT, FAST], ids=str)
def test_the_default_law_saturates_with_its_phase_kept_and_has_nothing_to_unwind(law: Law) -> None:
    phase_deg, release_ms = saturated(law)
    assert phase_deg < 0.1
    assert release_ms <= 1.5
    assert saturated(PI)[0] > 3.0


def saturated(law: Law) -> tuple[float, float]:
    """A damped plate gets a reference beyond the voltage, then half of it: the phase error in saturation, and the time
    to settle on the half, in ms."""
    asked = np.array([3.9, 0.0], dtype=np.complex128)
    trace, ticks = step_trace(law.board(LoopPlate(damping=1.8)), asked, 0.5 * asked), law.phase_ticks
    held, left = trace.plate_um[ticks - 20 : ticks, 0], trace.plate_um[ticks:, 0]
    response = measure(np.concatenate((left, left, left)), 3.9 / 2, law.tick_ms, law.tick_ms)
    return float(np.degrees(np.abs(np.angle(held)).max())), response.settling_ms


@pytest.mark.parametrize("law", [DEADBEAT, PI_FF], ids=str)
def test_a_reference_out_of_reach_is_shrunk_whole(law: Law) -> None:
    """At Q 200 the voltage holds under 2 um of the first mode; the pattern on the plate is kept, and follows a step."""
    config = BoardConfig(controller=law.controller, decay_1_s=decay_1_s(200.0))
    wanted_um = np.array([3.9 + 0j, 1])
    board = Board(nominal_plate(config), config=config)
    trace = step_trace(board, wanted_um * [1, -1], wanted_um)
    w_um = trace.plate_um[len(trace) // 2 :]
    np.testing.assert_allclose(w_um[-1] / w_um[-1, 0], wanted_um / wanted_um[0], atol=1e-3)
    assert 1.5 < w_um[-1, 0].real < 2
    assert settling_ms(w_um[:, 1], w_um[-1, 1], law.tick_ms) < 10
    (status,) = of_kind(BoardStatus, device.Decoder().feed(board.transmit()))
    assert status.saturated
    assert status.holdable_frac == pytest.approx((abs(w_um[-1, 0]) / 4.0,) * 2, abs=0.01)


@settings(max_examples=60)
@given(
    st.sampled_from(LAWS),
    st.floats(200.0, 1000.0),
    st.floats(0.5, 1.5),
    st.floats(-20.0, 20.0),
    st.floats(-0.17, 0.17),
    st.complex_numbers(max_magnitude=4.0),
)
def test_the_loop_is_stable_on_every_plate_of_the_grid(
    law: Law, quality: float, damping: float, detune_hz: float, phase_rad: float, asked_um: complex
) -> None:
    """Whatever was asked for, 0.1 s after letting go the plate is still, and no voltage was ever above its limit."""
    board = law.board(LoopPlate(quality, damping, detune_hz, phase_rad))
    trace = step_trace(board, np.array([asked_um, -0.7 * asked_um]), np.array([0j, 0j]))
    assert np.isfinite(trace.voltage_v).all()
    assert np.abs(trace.voltage_v).max() <= LIMIT_V * (1 + 1e-6)
    assert np.abs(trace.plate_um[-20:]).max() < 0.006
    assert (trace.flags & FLAG_LIVE).all()  # no fault


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
def test_gains_are_taken_exactly_where_the_plate_comes_to_rest(law: str, control_hz: float) -> None:
    """Gains with which the loop would swing on its own plate are refused."""
    for bandwidth_1_s in (10.0, 500.0, 2400.0, 5000.0, 20000.0):
        for integral_time_s in (0.0001, 0.0007, 0.005, 1.0):
            gains = {"bandwidth_1_s": bandwidth_1_s, "integral_time_s": integral_time_s}
            verdict = Bench(control_hz=control_hz).verdict(SetController(law, bandwidth_1_s, integral_time_s))
            driven = Bench(control_hz=control_hz, controller=law, **gains).board
            ticks = round(0.2 * control_hz)
            trace = follow(driven, constantly(0.3, -0.1), ticks, ticks // 20)
            held_v = trace.voltage_v[3 * ticks // 4 :]  # probes of sensors that little is asked of end within 0.14 s
            swings = not held_v.any() or bool(np.abs(np.diff(held_v, axis=0)).max() > 1.0)
            assert (verdict is CommandResult.DONE) is not swings, gains


@settings(max_examples=40)
@given(
    st.sampled_from(LAWS),
    st.floats(200.0, 1000.0),
    st.floats(0.5, 1.5),
    st.floats(-20.0, 20.0),
    st.floats(0.3, 1.5),
    st.floats(-3.2, 3.2),
)
def test_damping_and_detuning_are_learned_from_holding_an_amplitude(
    law: Law, quality: float, damping: float, detune_hz: float, amplitude_um: float, phase_rad: float
) -> None:
    """Under the sensors' noise and under any law: 5 % of the decay and 1 Hz within a quarter of a second."""
    plate = LoopPlate(quality, damping, detune_hz)
    board = law.board(plate)
    asked_um = amplitude_um * np.exp(1j * phase_rad)
    follow(board, constantly(asked_um, -asked_um), round(0.25 * law.control_hz), round(0.02 * law.control_hz))
    for mode, (decay, detuning) in enumerate(board.estimate()):
        assert decay == pytest.approx(damping * decay_1_s(quality)[mode], rel=0.05)
        true_hz = (-10.0, 10.0)[mode] + detune_hz
        assert detuning / (2 * np.pi) == pytest.approx(true_hz, abs=1.0)
