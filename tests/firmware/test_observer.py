"""The observer: its arithmetic against more digits, what it learns of a plate, and what it makes of nonsense."""

from __future__ import annotations

import ctypes
import math

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapticd.board_protocol import SetDrive
from hapticd.sim.board import firmware
from hapticd.sim.board.board import Board
from hapticd.sim.board.board import reference_decay_1_s as decay_1_s
from hapticd.sim.board.closed_loop import LIMIT_V, Law, LoopPlate, follow
from hapticd.values import ComplexArray
from hapticd.wire.commands import encode

from .bench import constantly, untouched

DEADBEAT, FAST, PI_FF, PI = Law("deadbeat"), Law("deadbeat", 5000.0), Law("pi_ff"), Law("pi")
LAWS = (DEADBEAT, FAST, PI_FF, PI)


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
