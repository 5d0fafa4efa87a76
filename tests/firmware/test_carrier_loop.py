"""The loop closed over real samples at 1 MHz: it does what the envelopes say, and what only a carrier can show."""

from __future__ import annotations

import numpy as np
import pytest
from carrier_board import CarrierBoard, Converters

from hapticd.sim.board.board import Board, BoardConfig, BoardTrace
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
    return CarrierBoard(nominal_plate(config), config=config, converters=converters)


def stepped(board: Board, amplitude_um: float) -> BoardTrace:
    """50 ms at rest, then 50 ms of one mode at `amplitude_um`."""
    ticks = round(0.1 * board.config.control_hz)

    def knots(t_s: float) -> list[tuple[float, ComplexArray]]:
        return [(0.0, np.array([amplitude_um if t_s > 0.0499 else 0.0, 0j]))]

    return follow(board, knots, ticks, ticks // 10)


def after_step(trace: BoardTrace) -> ComplexArray:
    return trace.plate_um[len(trace) // 2 :, 0]


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
