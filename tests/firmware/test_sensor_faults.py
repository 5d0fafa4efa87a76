"""Sensors that cannot be believed quieten the plate within 120 ms; a plate that drifts or is touched does not.

Half a sensor's gain looks like a damped plate and is left to the self-test.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.bench import endurance
from hapticd.bench.closed_loop import LIMIT_V, NOISE_UM, follow
from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.sim.board.carrier import Converters
from hapticd.sim.plate.wirings import PAPER, wiring
from hapticd.wire.protocol import FAULTS

QUIET_WITHIN_MS = 120.0
CONFIG = BoardConfig()
SWAPPED, DEAD = [[0.0, 1.0], [1.0, 0.0]], np.zeros((2, 2))
ONE_INVERTED, ONE_DEAD = np.diag([-1.0, 1.0]), np.diag([0.0, 1.0])
BROKEN: dict[str, dict[str, Any]] = {
    "dead": {"sensor": DEAD},
    "one dead": {"sensor": ONE_DEAD},
    "inverted": {"sensor": -np.eye(2)},
    "one inverted": {"sensor": ONE_INVERTED},
    "swapped": {"sensor": SWAPPED},
    "phase 50 degrees": {"loop_phase_rad": (math.radians(50),) * 2},
    "phase -50 degrees": {"loop_phase_rad": (math.radians(-50),) * 2},
    "phase 80 degrees": {"loop_phase_rad": (math.radians(80),) * 2},
    "2.5 times the gain": {"gain_um_per_v_s": 2.5 * np.diag(CONFIG.gain_um_per_v_s)},
    "2.5 times the signal": {"sensor": 2.5 * np.eye(2)},
}


def board(**changes: Any) -> Board:
    plate = {
        "decay_1_s": np.array(CONFIG.decay_1_s),
        "detuning_rad_s": np.array(CONFIG.detuning_rad_s),
        "gain_um_per_v_s": np.diag(CONFIG.gain_um_per_v_s),
        "sensor": np.eye(2),
        "noise_um": NOISE_UM,
        "amplifier_limit_v": LIMIT_V,
        "loop_phase_rad": (0.0, 0.0),
    } | changes
    return Board(PlateModel(**{name: _array(value) for name, value in plate.items()}), config=CONFIG)


def _array(value: object) -> Any:
    return np.asarray(value, float) if isinstance(value, list) else value


def held_ms(broken: Board, asked_um: tuple[float, float]) -> float:
    """How long there is any voltage, in a run of 0.4 s that asks for these amplitudes; infinite if to its end."""
    trace = follow(broken, lambda _: [(0.0, np.array(asked_um, complex))], 800, 100)
    driven = np.flatnonzero(np.abs(trace.voltage_v).max(axis=1))
    return math.inf if driven[-1] == 799 else float(driven[-1] - driven[0] + 1) / 2


@pytest.mark.parametrize("asked_um", [(0.02, 0.0), (0.4, 0.1), (2.0, 0.0), (3.9, 0.5)])
@pytest.mark.parametrize("name", BROKEN)
def test_a_sensor_that_cannot_be_believed_quietens_the_plate(name: str, asked_um: tuple[float, float]) -> None:
    assert held_ms(board(**BROKEN[name]), asked_um) <= QUIET_WITHIN_MS


@pytest.mark.parametrize("name", ["inverted", "swapped"])
def test_so_it_does_on_a_plate_that_should_rest(name: str) -> None:
    assert held_ms(board(**BROKEN[name]), (0.0, 0.0)) <= QUIET_WITHIN_MS


@pytest.mark.parametrize("phase_deg", [80, -80, 60, 50, -50])
@pytest.mark.parametrize("asked_um", [(2.0, 2.0), (3.0, 3.0), (2.0, -1.5)])
def test_so_does_a_wrong_phase_while_both_modes_are_asked_for_much(
    phase_deg: float, asked_um: tuple[float, float]
) -> None:
    assert held_ms(board(loop_phase_rad=(math.radians(phase_deg),) * 2), asked_um) <= QUIET_WITHIN_MS


@pytest.mark.parametrize("f_hz", [5.0, 30.0, 100.0])
@pytest.mark.parametrize("phase_deg", [50, -80])
def test_so_does_a_wrong_phase_while_a_texture_plays(phase_deg: float, f_hz: float) -> None:
    """Of 0.4 um. One of 3 um at 100 Hz takes all the voltage, and hides the limit cycle until it pauses."""

    def knots(t_s: float) -> list[tuple[float, Any]]:
        at_ms = np.arange(0.0, 22.5, 2.5)
        amplitudes_um = 0.4 * np.cos(2.0 * np.pi * f_hz * (t_s + 1e-3 * at_ms))
        return [(ms, w_um * np.array([1.0, -0.7 + 0j])) for ms, w_um in zip(at_ms, amplitudes_um, strict=True)]

    trace = follow(board(loop_phase_rad=(math.radians(phase_deg),) * 2), knots, 400, 40)
    assert (np.flatnonzero(np.abs(trace.voltage_v).max(axis=1))[-1] + 1) / 2 <= QUIET_WITHIN_MS


def clipped(offset_lsb: float, asked_um: float) -> BoardTrace:
    converters = Converters(offset_lsb=offset_lsb)
    config = replace(CONFIG, loop_phase_rad=(converters.loop_phase_rad(CONFIG.drive_hz),) * 2)
    plate = replace(board().model, noise_um=0.0, loop_phase_rad=())
    driven = Board(plate, config=config, converters=converters)
    return follow(driven, lambda _: [(0.0, np.array([asked_um, 0j]))], 300, 100)


@pytest.mark.parametrize("offset_lsb", [1700.0, -1700.0])
def test_a_sensor_whose_converter_clips_quietens_the_plate(offset_lsb: float) -> None:
    trace = clipped(offset_lsb, 2.0)
    driven = np.flatnonzero(np.abs(trace.voltage_v).max(axis=1))
    assert (driven[-1] - driven[0] + 1) / 2 <= QUIET_WITHIN_MS
    assert np.abs(trace.plate_um).max() < 2.5
    assert "rails" in FAULTS[9]


def test_an_offset_that_leaves_room_for_the_amplitude_is_no_fault() -> None:
    assert clipped(1500.0, 2.0).voltage_v[-1].any()


def test_a_reference_out_of_reach_ends_after_a_hundred_seconds(new_bench: Any) -> None:
    slow = replace(CONFIG, control_hz=500.0)
    bench = new_bench()
    bench.board = Board(replace(board().model, decay_1_s=2.0 * np.array(CONFIG.decay_1_s)), config=slow)
    bench.arm(3.9, 0.0)
    while bench.messages[-1].fault_code == 0:
        bench.say(bench.constant(3.9, 0.0))
        bench.run(20)
        assert bench.board.t_us < 101e6
    assert bench.messages[-1].fault_code == 10
    assert bench.board.t_us > 99e6
    assert not bench.run(10).voltage_v.any()


@pytest.mark.parametrize("asked_um", [(0.02, 0.0), (0.4, 0.1), (1.0, 0.5), (2.0, 2.0)])
def test_a_dead_sensor_that_sees_both_modes_quietens_the_plate(asked_um: tuple[float, float]) -> None:
    """But for the one that would see nothing of what is asked: then the plate does what it should."""
    wires = wiring(PAPER, 2)
    config = replace(
        CONFIG,
        gain_um_per_v_s=tuple(wires.gain * np.array(CONFIG.gain_um_per_v_s)),
        drive=wires.drive,
        sense=wires.sense,
    )
    gain = np.diag(CONFIG.gain_um_per_v_s) @ wires.drives
    for dead in (0, 1):
        alive = np.diag([float(s != dead) for s in range(2)])
        plate = replace(board().model, gain_um_per_v_s=gain, sensor=alive @ wires.senses)
        held = held_ms(Board(plate, config=config), asked_um)
        assert held <= QUIET_WITHIN_MS or abs(wires.senses[dead] @ asked_um) < 0.01


@pytest.mark.parametrize(("name", "code"), [("one dead", 4), ("one inverted", 8)])
def test_the_fault_says_which_of_both_it_is(name: str, code: int, new_bench: Any) -> None:
    bench = new_bench()
    bench.arm(1 + 0j, 0j)
    for _ in range(40):
        bench.board.fake_measurement(np.diag(BROKEN[name]["sensor"]) * np.array([0.9, 0.0]))
        bench.hold(20)
    assert bench.messages[-1].fault_code == code
    assert code in FAULTS


def test_drift_damping_fingers_and_any_references_are_no_fault() -> None:
    assert [sentence for seed in range(12) for sentence in endurance.play(seed, 1.0)[1].failures] == []


# Sound plates that earlier rules judged faulty: amplitudes alternate above 100 Hz while the drive is far off, with and
# without heavy fingers; fingers couple the modes at full voltage; a mode that others hold still.
ALTERNATING, ALTERNATING_TOUCHED, COUPLED, HELD = (
    (142, 150, 208),
    (688, 870, 1006, 1222, 1240),
    (57, 74, 231),
    (119, 196),
)


@pytest.mark.long
def test_no_plate_of_two_hundred_is_judged_faulty() -> None:
    assert [sentence for seed in range(12, 212) for sentence in endurance.play(seed, 10.0)[1].failures] == []


@pytest.mark.long
@pytest.mark.parametrize("seed", [*ALTERNATING_TOUCHED, *COUPLED, *HELD])
def test_a_sound_plate_that_was_judged_faulty_is_not(seed: int) -> None:
    assert endurance.play(seed)[1].failures == []


@pytest.mark.parametrize("seed", ALTERNATING)
def test_amplitudes_that_alternate_off_resonance_are_no_fault(seed: int) -> None:
    assert endurance.play(seed, 10.0)[1].failures == []
