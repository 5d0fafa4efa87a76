"""Wires and sensors that are far from a reference's modes quieten the plate within 120 ms too (the plain ones are
test_faults'); a plate that drifts or is touched does not.

Half a sensor's gain looks like a damped plate and is left to the self-test.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from soak import endurance

from hapticd.sim.board.board import Board, BoardConfig
from hapticd.sim.board.closed_loop import LIMIT_V, NOISE_UM, follow

from .bench import Bench, constantly, nominal_plate, quiet_after_ms

QUIET_WITHIN_MS = 120.0
CONFIG = BoardConfig()


def board(config: BoardConfig = CONFIG, **changes: Any) -> Board:
    return Board(nominal_plate(CONFIG, **{"noise_um": NOISE_UM} | changes), config=config)


def held_ms(broken: Board, asked_um: tuple[float, ...]) -> float:
    """How long there is any voltage, in a run of 0.4 s that asks for these amplitudes; infinite if to its end."""
    return quiet_after_ms(follow(broken, constantly(*asked_um), 800, 100))


@pytest.mark.parametrize(("glitch_um", "code"), [(20.0, 7), (1e10, 7), (1e18, 7), (1e25, 2), (1e38, 2)])
def test_one_absurd_measurement_is_a_fault_and_moves_the_plate_within_its_limit(
    bench: Bench, glitch_um: float, code: int
) -> None:
    bench.arm(1 + 0j, 0.5 + 0j)
    bench.hold(40)
    bench.board.fake_measurement(np.full(2, complex(glitch_um)))
    bench.run(1)
    bench.board.fake_measurement(None)
    trace = bench.hold(120)
    assert bench.messages[-1].fault_code == code
    assert not trace.voltage_v[-1].any()
    assert np.abs(trace.plate_um).max() <= 4.0


@pytest.mark.parametrize("modes", [2, 4, 6, 8])
@pytest.mark.parametrize("scale", [0.1, 1.0])
def test_a_dead_sensor_of_a_mode_far_from_the_drive_quietens_the_plate(modes: int, scale: float) -> None:
    """Whose amplifier reaches a tenth of what is asked at most."""
    config = BoardConfig(
        w_limit_um=(4.0,) * modes,
        decay_1_s=CONFIG.decay_1_s[:1] * modes,
        detuning_rad_s=tuple(2.0 * np.pi * np.linspace(-300.0, 300.0, modes)),
        gain_um_per_v_s=CONFIG.gain_um_per_v_s[:1] * modes,
        loop_phase_rad=(0.0,) * modes,
    )
    for dead in range(modes):
        alive = np.diag([float(k != dead) for k in range(modes)])
        plate = nominal_plate(config, sensor=alive, noise_um=NOISE_UM)
        assert held_ms(Board(plate, config=config), (3.9 * scale,) * modes) <= QUIET_WITHIN_MS


@pytest.mark.parametrize("detuned_frac", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("asked_um", [(0.0, 0.7), (0.7, 0.0), (0.1, 0.7), (0.3, 0.5)])
def test_a_mode_that_a_heavy_finger_pushes_from_its_reference_is_no_fault(
    asked_um: tuple[float, float], detuned_frac: float
) -> None:
    ticks, heavy_1_s = 2000, 600.0
    phi, load_1_s = np.ones((ticks, 1, 2)), np.full((ticks, 1), heavy_1_s)
    touch = (phi, load_1_s, detuned_frac * load_1_s)
    trace = follow(board(), constantly(*asked_um), ticks, 100, touch)
    assert (np.abs(trace.voltage_v[-1]) > 0.5 * LIMIT_V).any()


@pytest.mark.parametrize("known", [0.9, 1.1])
@pytest.mark.parametrize("angle_deg", range(0, 360, 45))
def test_feedthrough_that_is_known_to_a_tenth_does_not_look_like_wrong_wires(angle_deg: float, known: float) -> None:
    """On a plate of half the damping, 100 Hz off."""
    through = 0.02 * cmath.exp(1j * math.radians(angle_deg)) * np.eye(2)
    sound = board(
        replace(CONFIG, feedthrough_um_per_v=known * through),
        decay_1_s=0.5 * np.array(CONFIG.decay_1_s),
        detuning_rad_s=np.array(CONFIG.detuning_rad_s) + 2.0 * np.pi * 100.0,
        through_um_per_v=through,
    )
    assert held_ms(sound, (1.0, 0.6)) == math.inf


def test_drift_damping_fingers_and_any_references_are_no_fault() -> None:
    assert [sentence for seed in range(12) for sentence in endurance.play(seed, 1.0).failures] == []


# Sound plates that earlier rules judged faulty: amplitudes alternate above 100 Hz while the drive is far off, with and
# without heavy fingers; fingers couple the modes at full voltage; a mode that others hold still; a texture in step with
# the modes' turns.
JUDGED_FAULTY = (142, 150, 208, 688, 870, 1006, 1222, 1240, 57, 74, 231, 119, 196, 11050)


@pytest.mark.long
@pytest.mark.parametrize("seed", [*range(12, 112), *JUDGED_FAULTY])
def test_no_sound_plate_is_judged_faulty(seed: int) -> None:
    assert endurance.play(seed, 10.0).failures == []
