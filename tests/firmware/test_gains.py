"""Gains with which the loop would swing on its own plate are refused; those that work are taken."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.board_protocol import CommandResult
from hapticd.board_values import SetController
from hapticd.sim.board.closed_loop import follow

from .bench import Bench, constantly


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
def test_gains_are_taken_exactly_where_the_plate_comes_to_rest(law: str, control_hz: float) -> None:
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
