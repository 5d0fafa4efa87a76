"""Amplifiers and sensors that each serve several modes: the paper's rig is driven as well as one mode per amplifier."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.board_protocol import FAULTS, CommandResult, LogRequest
from hapticd.board_values import BoardLog, ModeModel, SetModel, SetWiring
from hapticd.sim.board.board import Board, BoardConfig
from hapticd.sim.board.closed_loop import LIMIT_V, NOISE_UM, follow
from hapticd.sim.plate.wirings import IDENTITY, PAPER, wiring
from hapticd.wire import device
from hapticd.wire.commands import encode

from .bench import Bench, constantly, nominal_plate, of_kind

OWN = BoardConfig()
QUIET_WITHIN_MS = 120.0


def board(name: str = PAPER, *, through: Any = None, **known: Any) -> Board:
    """A board that knows this wiring, on a plate that has it."""
    wires = wiring(name, 2)
    gain = np.diag(OWN.gain_um_per_v_s) @ wires.drives
    plate = nominal_plate(
        OWN,
        gain_um_per_v_s=gain,
        sensor=wires.senses,
        noise_um=NOISE_UM,
        through_um_per_v=through,
    )
    nominal = tuple(wires.gain * np.array(OWN.gain_um_per_v_s))
    return Board(plate, config=replace(OWN, gain_um_per_v_s=nominal, drive=wires.drive, sense=wires.sense, **known))


def faults(of: Board) -> list[int]:
    of.receive(device.encode(LogRequest()))
    (log,) = of_kind(BoardLog, device.Decoder().feed(of.transmit()))
    return [entry.code for entry in log.entries if entry.code in FAULTS]


def steps(random: np.random.Generator) -> Any:
    def knots(_: float) -> list[tuple[float, npt.NDArray[np.complex128]]]:
        return [(0.0, random.uniform(-4, 4, 2) * np.exp(1j * random.uniform(0, 6.28, 2)))]

    return knots


def test_no_amplifier_is_ever_above_its_limit_and_both_modes_reach_theirs() -> None:
    trace = follow(board(), steps(np.random.default_rng(3)), 8000, 40)
    assert np.abs(trace.voltage_v).max() <= LIMIT_V * (1.0 + 1e-6)
    for sign in (1.0, -1.0, 1j):
        held = follow(board(), constantly(3.9, 3.9 * sign), 400, 100)
        np.testing.assert_allclose(held.plate_um[-50:].mean(axis=0), [3.9, 3.9 * sign], atol=0.01)


def test_a_board_that_is_given_its_wiring_drives_the_papers_plate(bench: Bench) -> None:
    wires = wiring(PAPER, 2)
    bench.board = Board(board().model, config=OWN)
    both = tuple(map(tuple, wires.drive)), tuple(map(tuple, wires.sense)), ((0.0,) * 2,) * 2
    for k in (0, 1):
        model = ModeModel(OWN.decay_1_s[k], OWN.detuning_rad_s[k], 2.0 * OWN.gain_um_per_v_s[k], 1 + 0j)
        bench.say(encode(SetModel(k, model)))
    bench.say(encode(SetWiring(*both)))
    bench.arm(2.0, -1.0)
    trace = bench.hold(100)
    np.testing.assert_allclose(trace.plate_um[-1], [2.0, -1.0], atol=0.01)


def test_feedthrough_that_is_not_known_ends_in_a_fault() -> None:
    unknown = board(IDENTITY, through=0.02 * np.eye(2))
    follow(unknown, constantly(2.0, -1.0), 400, 100)
    assert faults(unknown) == [7]


OWN_WIRES, NO_WIRES = ((1.0, 0.0), (0.0, 1.0)), ((0.0, 0.0),) * 2


@pytest.mark.parametrize("second", [(1.0, 1.0), (1.0, 0.99)], ids=["singular", "nearly so"])
def test_a_board_refuses_amplifiers_that_cannot_drive_the_modes_independently(
    bench: Bench, second: tuple[float, float]
) -> None:
    assert bench.verdict(SetWiring(((1.0, 1.0), second), OWN_WIRES, NO_WIRES)) is CommandResult.OUT_OF_RANGE
