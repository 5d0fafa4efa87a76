"""Gains with which the loop would swing on its own plate are refused; those that work are taken."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hapticd.bench.closed_loop import follow
from hapticd.board_values import BoardVerdict, SetGains, Verdict
from hapticd.sim.board.board import BoardConfig
from hapticd.wire.commands import encode

ASKED_UM = np.array([0.3, -0.1])


def verdict(bench: Any, law: str, bandwidth_1_s: float, integral_time_s: float) -> Verdict:
    bench.board.receive(encode(SetGains(law, bandwidth_1_s, integral_time_s)))
    (found,) = (message for message in bench.listen() if isinstance(message, BoardVerdict))
    taken: Verdict = found.verdict
    return taken


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
def test_gains_are_taken_exactly_where_the_plate_comes_to_rest(law: str, control_hz: float, new_bench: Any) -> None:
    for bandwidth_1_s in (10.0, 500.0, 2400.0, 5000.0, 20000.0):
        for integral_time_s in (0.0001, 0.0007, 0.005, 1.0):
            gains = {"bandwidth_1_s": bandwidth_1_s, "integral_time_s": integral_time_s}
            bench = new_bench(control_hz=control_hz)
            is_taken = verdict(bench, law, *gains.values()) is Verdict.DONE
            driven = new_bench(control_hz=control_hz, controller=law, **gains).board
            ticks = round(0.2 * control_hz)
            trace = follow(driven, lambda _: [(0.0, ASKED_UM + 0j)], ticks, ticks // 20)
            held_v = trace.voltage_v[ticks // 2 :]
            swings = not held_v.any() or bool(np.abs(np.diff(held_v, axis=0)).max() > 1.0)
            assert is_taken is not swings, gains


def test_the_default_gains_are_taken(new_bench: Any) -> None:
    for law in ("pi", "pi_ff", "deadbeat"):
        bench = new_bench()
        bench.board.receive(encode(SetGains(law)))
        assert [message.verdict for message in bench.listen()] == [Verdict.DONE]
    assert BoardConfig().controller == "deadbeat"
