"""Eight modes through the whole path: builds, frames, telemetry, worlds, and what two fingers feel."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from hapticd.bench.loop import measured
from hapticd.board_protocol import SetTelemetry
from hapticd.board_values import TelemetrySample
from hapticd.config import Config
from hapticd.config.sections import MOST_MODES
from hapticd.core.trajectory.gate import gate
from hapticd.daemon.settings import BITS_PER_BYTE, LONGEST_FRAME_S, max_knots
from hapticd.sim.board.board import PLATE_MODES_MAX, Board, BoardConfig, BoardTrace, PlateModel
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import Simulation
from hapticd.sim.plate.glasses import WIDE
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings
from hapticd.values import Drive, Knot
from hapticd.wire.commands import encode, encode_reference
from hapticd.wire.device import Decoder

MS = 1_000_000
EIGHT_UM = (4.0,) * MOST_MODES


def a_board(plate_modes: int) -> Board:
    parasitic = plate_modes - MOST_MODES
    config = BoardConfig(
        w_limit_um=EIGHT_UM,
        decay_1_s=(183.0,) * 8,
        detuning_rad_s=tuple(np.linspace(-1000.0, 1000.0, 8)),
        gain_um_per_v_s=(6.0,) * 8,
    )
    plate = PlateModel(
        np.full(plate_modes, 183.0),
        np.array([*config.detuning_rad_s, *(3000.0,) * parasitic]),
        np.vstack([6.0 * np.eye(8), np.full((parasitic, 8), 0.1)]),
        np.hstack([np.eye(8), np.full((8, parasitic), 0.01)]),
        0.0,
        150.0,
    )
    return Board(plate, config=config)


def test_a_plate_of_eight_driven_modes_has_room_for_two_parasitic_ones_and_no_more() -> None:
    assert PLATE_MODES_MAX == MOST_MODES + 2
    a_board(PLATE_MODES_MAX)
    with pytest.raises(ValueError, match="1 to 10 modes, not 11"):
        a_board(PLATE_MODES_MAX + 1)


def test_telemetry_of_eight_modes_arrives_whole() -> None:
    """Its 267 bytes do not fit into a length of one byte."""
    board = a_board(MOST_MODES)
    board.receive(encode(SetTelemetry(1000)))
    trace = BoardTrace(100, MOST_MODES, MOST_MODES)
    board.run(100, np.zeros((100, 0, MOST_MODES)), np.zeros((100, 0)), trace)
    decoder, samples = Decoder(), []
    while said := board.transmit():
        samples += [one for one in decoder.feed(said) if isinstance(one, TelemetrySample)]
    assert not any(decoder.counters.values())
    assert {len(sample.modes) for sample in samples} == {MOST_MODES}
    assert [sample.modes[7].detuning_rad_s for sample in samples][-1] == pytest.approx(1000.0)


@pytest.mark.parametrize(("baud", "knots"), [(921600, 3), (3_000_000, 13), (5_250_000, 16)])
def test_a_frame_has_as_many_knots_as_the_line_carries_in_3_ms(baud: int, knots: int) -> None:
    config = replace(Config(), limits=replace(Config().limits, w_limit_um=EIGHT_UM))
    assert max_knots(config, baud) == knots
    modal_um = tuple(complex(1.0 / (mode + 1), 0.1) for mode in range(MOST_MODES))
    drive = gate(Drive(0, tuple(Knot(MS * place, modal_um) for place in range(knots))), EIGHT_UM)
    assert len(encode_reference(1, drive, 0)) * BITS_PER_BYTE <= LONGEST_FRAME_S * baud


def test_two_fingers_feel_what_was_asked_on_eight_modes(caplog: pytest.LogCaptureFixture) -> None:
    """With the three knots a frame that the slow line carries, which is said once."""
    caplog.set_level(logging.INFO)
    settings = Settings(plate=replace(PlateSettings.of(WIDE), sensor_crosstalk=0.0))  # as calibrated
    simulation = Simulation(SCENARIOS["strokes"].build(1, settings.speed_mm_s), settings, 1, measured(settings, 1))
    simulation.run(3.0)
    run = simulation.result("strokes")
    assert run.modal_um.shape[1] == MOST_MODES
    assert run.score.felt_frac > 0.95
    assert run.score.contrast > 18.0
    sentence = "a reference frame of 8 modes has 3 knots, not 16: at 921600 baud more take over 3 ms"
    assert caplog.text.count(sentence) == 1
    board = simulation.machine.report_status(0)["board"]
    assert isinstance(board, dict)
    assert board["max_knots"] == 3
