"""The loop closed over real samples at 1 MHz: it does what the envelopes say, and what only a carrier can show."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.sim.board.board import Board, BoardConfig, BoardTrace
from hapticd.sim.board.carrier import SAMPLE_HZ, Converters
from hapticd.sim.board.closed_loop import follow, settling_ms
from hapticd.values import ComplexArray

from .bench import nominal_plate

DRIVE_HZ = 29205.0
LAWS = ("pi", "pi_ff", "deadbeat")
QUIET = Converters(noise_lsb=0.0)


def new_board(
    controller: str = "deadbeat",
    converters: Converters | None = QUIET,
    *,
    known_phase_rad: float | None = None,
    control_hz: float = 2000.0,
) -> Board:
    """The nominal plate, without noise but for the converters'; the board is calibrated to their loop phase."""
    if known_phase_rad is None:
        known_phase_rad = 0.0 if converters is None else converters.loop_phase_rad(DRIVE_HZ)
    config = BoardConfig(controller=controller, control_hz=control_hz, loop_phase_rad=(known_phase_rad,) * 2)
    return Board(nominal_plate(config), config=config, converters=converters)


def stepped(board: Board, amplitude_um: float) -> BoardTrace:
    """50 ms at rest, then 50 ms of one mode at `amplitude_um`."""
    ticks = round(0.1 * board.config.control_hz)

    def knots(t_s: float) -> list[tuple[float, ComplexArray]]:
        return [(0.0, np.array([amplitude_um if t_s > 0.0499 else 0.0, 0j]))]

    return follow(board, knots, ticks, ticks // 10)


def after_step(trace: BoardTrace) -> ComplexArray:
    return trace.plate_um[len(trace) // 2 :, 0]


def ripple_um(w_um: ComplexArray) -> float:
    return math.sqrt(float(np.mean(np.abs(w_um - w_um.mean()) ** 2)))


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
@pytest.mark.parametrize("amplitude_um", [0.4, 1.0, 2.0])
@pytest.mark.parametrize("controller", LAWS)
def test_carrier_and_envelopes_agree_on_a_step(controller: str, amplitude_um: float, control_hz: float) -> None:
    envelope, carrier = (
        after_step(stepped(new_board(controller, converters, control_hz=control_hz), amplitude_um))
        for converters in (None, QUIET)
    )
    tick_ms = 1e3 / control_hz
    settled_ms = [settling_ms(w_um, amplitude_um, tick_ms) for w_um in (envelope, carrier)]
    assert abs(settled_ms[0] - settled_ms[1]) < 1.5 * tick_ms
    # reading W off a real signal that moves at g V is uncertain by g V / 2 w = 2 nm, in the test and in the firmware
    assert np.abs(carrier - envelope).max() < 0.004 + 0.005 * amplitude_um
    assert abs(carrier[-20:].mean() - amplitude_um) < 0.001 * amplitude_um


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
def test_a_held_amplitude_is_measured_to_what_quantisation_and_noise_leave(control_hz: float) -> None:
    converters = Converters()
    trace = stepped(new_board("pi_ff", converters, control_hz=control_hz), 2.0)
    held = slice(-round(0.02 * control_hz), None)
    # each axis: sqrt(2 / N) times the noise of a sample, its own step of 1/12 included
    expected_um = converters.um_per_lsb * math.sqrt((1 + 1 / 12) * 4 / (SAMPLE_HZ / control_hz))
    assert ripple_um(trace.measured_um[held, 0]) == pytest.approx(expected_um, rel=0.5)
    assert ripple_um(trace.plate_um[held, 0]) < 0.0004
    assert abs(trace.plate_um[held, 0].mean() - 2.0) < 0.001
