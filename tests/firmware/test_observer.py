"""The observer: its arithmetic against more digits, what it learns of a plate, and what it makes of nonsense."""

from __future__ import annotations

import ctypes
import math
from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapticd.bench.closed_loop import LIMIT_V, Law, LoopPlate, follow, step_trace
from hapticd.board_protocol import SetDrive
from hapticd.sim.board import firmware
from hapticd.sim.board.board import CHUNK_S, Board
from hapticd.sim.board.board import reference_decay_1_s as decay_1_s
from hapticd.sim.board.board import reference_gain_um_per_v_s as gain_um_per_v_s
from hapticd.values import ComplexArray
from hapticd.wire.commands import encode

from .bench import constantly, untouched

DEADBEAT, FAST, PI_FF, PI = Law("deadbeat"), Law("deadbeat", 5000.0), Law("pi_ff"), Law("pi")
LAWS = (DEADBEAT, FAST, PI_FF, PI)
STATE_BANDWIDTHS, NEWEST, MEMORY_S, LEAST_UM, MODES = 2.0, 4.0, 0.02, 0.1, 2


class Hold(NamedTuple):
    """One mode under a constant voltage for a time: final and mean amplitude, per initial um and per V."""

    keep: complex
    push: complex
    mean_keep: complex
    mean_push: complex


def hold(rate_1_s: complex, gain: float, span_s: float) -> Hold:
    """dW/dt = rate W + gain u, solved over `span_s`."""
    keep = np.exp(rate_1_s * span_s)
    mean_keep = (keep - 1) / (rate_1_s * span_s)
    return Hold(keep, gain * span_s * mean_keep, mean_keep, gain * (mean_keep - 1) / rate_1_s)


class Phasor(ctypes.Structure):
    _fields_ = [("d", ctypes.c_float), ("q", ctypes.c_float)]


class Exponential(ctypes.Structure):
    _fields_ = [("exp", Phasor), ("phi1", Phasor), ("phi2", Phasor)]


def exponential(z: complex) -> tuple[complex, complex, complex]:
    function = firmware.load(2).hd_exponential
    function.argtypes, function.restype = [Phasor], Exponential
    result = function(Phasor(z.real, z.imag))
    return tuple(complex(part.d, part.q) for part in (result.exp, result.phi1, result.phi2))


@settings(max_examples=300)
@given(st.floats(-2.75, 2.75, width=32), st.floats(-2.75, 2.75, width=32))
@example(0.0, 0.0)
@example(-1e-30, 1e-30)
@example(0.5, 0.0)
@example(-2.8, 2.8)
def test_the_exponential_and_its_differences_agree_with_mpmath(real: float, imag: float) -> None:
    z = mpmath.mpc(real, imag)
    with mpmath.workdps(60):
        exact = (
            mpmath.exp(z),
            mpmath.mpf(1) if z == 0 else mpmath.expm1(z) / z,
            mpmath.mpf(1) / 2 if z == 0 else (mpmath.expm1(z) / z - 1) / z,
        )
        if abs(z) < 1e-20:
            exact = (exact[0], mpmath.mpf(1), mpmath.mpf(1) / 2)
    for result, wanted in zip(exponential(complex(real, imag)), exact, strict=True):
        assert abs(result - complex(wanted)) <= 1e-6 * abs(complex(wanted)) + 1e-7


class Double:
    """The deadbeat law and its observer for one mode in float64: firmware/core/observer.h and control.h, written anew.

    `tick` takes the goal and the mean over the tick just ended and gives u.
    """

    def __init__(self, rate_1_s: complex, gain: float, tick_s: float) -> None:
        ahead_s, back_s = tick_s - CHUNK_S, -CHUNK_S
        whole, ahead, back = (hold(rate_1_s, gain, span_s) for span_s in (tick_s, ahead_s, back_s))
        self.gain, self.a, self.b = gain, whole.keep, whole.push
        self.c = (ahead_s * ahead.mean_keep - back_s * back.mean_keep) / tick_s
        self.new, self.old = ahead_s * ahead.mean_push / tick_s, -back_s * back.mean_push / tick_s
        both = self.new + self.old
        bandwidth_1_s, integral_time_s = (3000.0, 0.0005) if tick_s < 0.00025 else (2400.0, 0.0007)
        self.pole = math.exp(-bandwidth_1_s * tick_s)
        poles = np.array([math.exp(-STATE_BANDWIDTHS * bandwidth_1_s * tick_s), math.exp(-tick_s / integral_time_s)])
        # Pole placement by Ackermann's formula, for the pair that the correction follows.
        f = np.array([[self.a, self.b], [0, 1]])
        h = np.array([self.c, both])
        desired = (f - poles[0] * np.eye(2)) @ (f - poles[1] * np.eye(2))
        predictor = desired @ np.linalg.solve(np.array([h, h @ f]), np.array([0, 1]))
        self.gains = np.linalg.solve(f, predictor)
        self.newest_1_s = min(1.0, NEWEST * float(np.prod(1 - poles))) / tick_s
        self.forget = math.exp(-tick_s / MEMORY_S)
        self.w = self.d = self.x = self.u = self.u_old = self.moment = self.coupling = 0j
        self.power = self.coupling_power = 0.0
        self.ticks = 0

    def learn(self, w_um: complex, cause: complex, newest: complex) -> None:
        """Damping and detuning at this mode's turn, and what is left for its own row of the couplings at each tick."""
        self.ticks += 1
        if abs(w_um) <= LEAST_UM:
            return
        if self.ticks % MODES != 0:
            before = self.moment / self.power if self.power > 0 else 0j
            self.moment = self.forget**MODES * self.moment + w_um.conjugate() * cause
            self.power = self.forget**MODES * self.power + abs(w_um) ** 2
            self.coupling += self.moment / self.power - before
        self.coupling_power = self.forget * self.coupling_power + abs(w_um) ** 2
        left = cause + newest - self.coupling * w_um
        self.coupling += left * w_um.conjugate() / self.coupling_power

    def tick(self, goal_um: complex, measured_um: complex) -> complex:
        expected = self.c * self.w + self.new * (self.u + self.d) + self.old * (self.u_old + self.d)
        innovation = measured_um - expected
        before = self.w + self.gains[0] * innovation
        self.d = self.d + self.gains[1] * innovation
        self.w = self.a * before + self.b * (self.u + self.d)
        self.learn(before, self.gain * self.d, self.newest_1_s * innovation)
        self.d += self.coupling / self.gain * (self.w - before)
        stay = ((1 - self.pole) * self.x + (self.pole - self.a) * self.w) / self.b - self.d
        move = (goal_um - self.x) / self.b
        budget = max(LIMIT_V, abs(stay) + 0.03 * LIMIT_V)
        fractions = np.roots([abs(move) ** 2, 2 * (stay.conjugate() * move).real, abs(stay) ** 2 - budget**2])
        fraction = 1.0 if abs(stay + move) <= budget else float(fractions.real.max())
        self.x += fraction * (goal_um - self.x)
        u = stay + fraction * move
        self.u_old, self.u = self.u, u * min(1.0, LIMIT_V / abs(u))
        return self.u


@pytest.mark.parametrize("law", [DEADBEAT, FAST], ids=str)
@pytest.mark.parametrize("plate", [LoopPlate(), LoopPlate(200.0, 0.5, -20.0), LoopPlate(1000.0, 1.0, 20.0)], ids=str)
def test_single_precision_costs_a_few_picometres(law: Law, plate: LoopPlate) -> None:
    """The same law in float64 on the exact plate, all along a step."""
    goal_um = 1.3 + 0.4j
    gain, tick_s = gain_um_per_v_s(plate.quality), law.tick_ms * 1e-3
    trace = step_trace(law.board(plate, noise_um=0.0), np.zeros(2, complex), np.array([goal_um, 0]))
    double = Double(complex(-decay_1_s(plate.quality)[0], -20 * math.pi), gain, tick_s)
    rate_1_s = complex(-plate.decay_1_s, 2 * math.pi * (plate.detune_hz - 10.0))
    early, late, share = hold(rate_1_s, gain, CHUNK_S), hold(rate_1_s, gain, tick_s - CHUNK_S), CHUNK_S / tick_s
    w_um = u_v = old_v = 0j
    worst_um = worst_v = 0.0
    for i in range(law.phase_ticks, 2 * law.phase_ticks):
        mean_um = share * (early.mean_keep * w_um + early.mean_push * old_v)
        w_um = early.keep * w_um + early.push * old_v
        mean_um += (1 - share) * (late.mean_keep * w_um + late.mean_push * u_v)
        w_um = late.keep * w_um + late.push * u_v
        old_v, u_v = u_v, double.tick(goal_um, mean_um)
        worst_um = max(worst_um, abs(w_um - trace.plate_um[i, 0]))
        worst_v = max(worst_v, abs(1j * u_v - trace.voltage_v[i, 0]))
    assert worst_um < 4e-6  # 2.3e-6 measured: five and a half digits of 1.36 um
    assert worst_v < 1e-3  # 6.8e-4: as many of 150 V


def hold_for(board: Board, w_um: ComplexArray, seconds: float) -> None:
    ticks = round(seconds * board.config.control_hz)
    follow(board, constantly(*w_um), ticks, round(0.02 * board.config.control_hz))


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
    hold_for(board, np.array([amplitude_um, -amplitude_um]) * np.exp(1j * phase_rad), 0.25)
    for mode, (decay, detuning) in enumerate(board.estimate()):
        assert decay == pytest.approx(damping * decay_1_s(quality)[mode], rel=0.05)
        true_hz = (-10.0, 10.0)[mode] + detune_hz
        assert detuning / (2 * math.pi) == pytest.approx(true_hz, abs=1.0)


def test_nothing_is_learned_from_silence() -> None:
    board = DEADBEAT.board(LoopPlate(damping=1.4, detune_hz=9.0))
    board.receive(encode(SetDrive(board.config.drive_hz, 0.0)))  # it stays, and so does the frame of the estimates
    np.testing.assert_allclose(board.estimate(), np.transpose([decay_1_s(), (-20 * np.pi, 20 * np.pi)]), rtol=1e-6)
    hold_for(board, np.array([1.0 + 0j, 1.0]), 0.2)
    learned = board.estimate()
    untouched(board, 2000)  # the host has fallen silent
    np.testing.assert_allclose(board.estimate(), learned, rtol=0.02, atol=1.0)
    silent = board.estimate()
    untouched(board, 2000)
    np.testing.assert_array_equal(board.estimate(), silent)


MEASUREMENTS = st.lists(
    st.one_of(
        st.complex_numbers(max_magnitude=5.9),
        st.sampled_from([1e10 + 0j, 1e38j, complex(math.nan, 0), complex(0, math.inf), -1e30 + 1e30j]),
    ),
    min_size=1,
    max_size=12,
)


@settings(max_examples=150)
@given(st.sampled_from(["pi", "pi_ff", "deadbeat"]), MEASUREMENTS, st.integers(1, 7))
def test_whatever_the_sensors_say_voltages_and_estimates_stay_finite_and_bounded(
    controller: str, measured_um: list[complex], ticks: int
) -> None:
    board = Law(controller).board(LoopPlate())
    hold_for(board, np.array([1.0 + 0j, -1.0]), 0.02)
    for value in measured_um:
        board.fake_measurement(np.array([value, -0.5 * value]))
        trace = untouched(board, ticks)
        assert (np.abs(trace.voltage_v) <= LIMIT_V * (1 + 1e-6)).all()  # False for NaN
        assert np.isfinite(board.estimate()).all()
        assert (np.abs(board.estimate()) < 2000.0).all()
