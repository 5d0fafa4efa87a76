"""The drive follows a plate that warms: it keeps its reach, and stays where nothing is known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.board_protocol import ClearFault, CommandResult, ControllerRequest, SetDrive
from hapticd.board_values import BoardController, BoardStatus
from hapticd.sim.board.board import Board, BoardConfig
from hapticd.sim.board.closed_loop import NOISE_UM, follow
from hapticd.wire import device
from hapticd.wire.commands import encode

from .bench import Bench, constantly, nominal_plate, of_kind

CONFIG = BoardConfig()
STILL = constantly(4.0, 4.0j)
DRIVE_HZ, TURN_RAD = CONFIG.drive_hz, 2.0 * np.pi


def board() -> Board:
    return Board(nominal_plate(CONFIG, noise_um=NOISE_UM), config=CONFIG)


def drive_hz(of: Board) -> float:
    of.receive(device.encode(ClearFault()))
    return of_kind(BoardStatus, device.Decoder().feed(of.transmit()))[-1].drive_hz


def drifting(of: Board, seconds: float, hz_per_s: float, *, apart_hz: float = 0.0) -> float:
    """Least reach (um) of both modes, from the first tenth of a second on, while the plate drifts."""

    def knots(t_s: float) -> list[tuple[float, npt.NDArray[np.complex128]]]:
        hz = t_s * hz_per_s + np.array([-0.5, 0.5]) * apart_hz
        of.detune(np.array(CONFIG.detuning_rad_s) + TURN_RAD * hz)
        return STILL(t_s)

    trace = follow(of, knots, round(seconds * CONFIG.control_hz), 40)
    return float(np.abs(trace.plate_um[200:]).min())


def without_following(of: Board) -> Board:
    of.receive(encode(SetDrive(DRIVE_HZ, 0.0)))
    return of


def test_the_drive_follows_a_plate_that_drifts_and_keeps_its_reach() -> None:
    """4 Hz/s for 8 s; left behind, the plate would reach half."""
    followed, left = board(), without_following(board())
    assert drifting(followed, 8.0, 4.0) > 3.1
    assert drifting(left, 8.0, 4.0) < 2.5
    assert drive_hz(followed) == pytest.approx(DRIVE_HZ + 18.0, abs=4.0)
    assert drive_hz(left) == DRIVE_HZ


def test_a_set_drive_leaves_the_modes_where_they_are(bench: Bench) -> None:
    assert bench.verdict(SetDrive(DRIVE_HZ + 10.0, 0.0)) is CommandResult.DONE
    (controller,) = of_kind(BoardController, bench.say(encode(ControllerRequest())))
    for model, before in zip(controller.models, CONFIG.detuning_rad_s, strict=True):
        assert model.detuning_rad_s == pytest.approx(before - TURN_RAD * 10.0, abs=1e-3)
    bench.arm(3.0 + 0j, 2j)
    assert bench.hold(100).plate_um[-1] == pytest.approx(np.array([3.0, 2j]), abs=0.01)
    assert bench.status().drive_hz == DRIVE_HZ + 10.0


@pytest.mark.parametrize(("hz", "follow_hz"), [(27000.0, 0.0), (31300.0, 0.0), (DRIVE_HZ, 500.0)])
def test_a_drive_is_taken_near_the_first_one_and_on_a_quiet_plate(bench: Bench, hz: float, follow_hz: float) -> None:
    assert bench.verdict(SetDrive(hz, follow_hz)) is (
        CommandResult.DONE if hz == DRIVE_HZ else CommandResult.OUT_OF_RANGE
    )
    bench.arm(1.0 + 0j, 0j)
    assert bench.verdict(SetDrive(DRIVE_HZ, 0.0)) is CommandResult.NOT_QUIET
