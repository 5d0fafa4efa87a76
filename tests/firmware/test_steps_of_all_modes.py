"""Steps of two to eight modes at once, from one random feasible reference to another, under the amplifiers' limits."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.bench.closed_loop import LIMIT_V, NOISE_UM, SETTLED_FRAC, step
from hapticd.sim.board.board import Board, BoardConfig
from hapticd.values import ComplexArray

from .bench import nominal_plate

CONTROL_HZ, DECAY_1_S = 5000.0, 183.0
OFF_THE_WAY_UM = {150.0: 0.01, 300.0: 0.035}  # by how far modes may be from the drive, Hz
MOST_MS, SHARE = 6.0, 0.5  # of what the voltage holds of each mode


def random_step(modes: int, farthest_hz: float, seed: int) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """References before and after, and the amplitudes (ticks, modes) from the tick of the step on."""
    random = np.random.default_rng(seed)
    detuning_rad_s = 2 * np.pi * random.uniform(-farthest_hz, farthest_hz, modes)
    held_um = random.uniform(1.5, 3.0, modes)
    gain = held_um * np.hypot(DECAY_1_S, detuning_rad_s) / LIMIT_V
    config = BoardConfig(
        control_hz=CONTROL_HZ,
        decay_1_s=(DECAY_1_S,) * modes,
        detuning_rad_s=tuple(detuning_rad_s),
        gain_um_per_v_s=tuple(gain),
        loop_phase_rad=(0.0,) * modes,
        w_limit_um=(4.0,) * modes,
    )
    board = Board(nominal_plate(config, noise_um=NOISE_UM), config=config)
    before, after = (SHARE * held_um * random.uniform(-1, 1, modes) + 0j for _ in range(2))
    return before, after, step(board, before, after)


@pytest.mark.parametrize("farthest_hz", OFF_THE_WAY_UM)
@pytest.mark.parametrize("modes", range(2, 9))
def test_all_modes_settle_within_6_ms_on_a_straight_way(modes: int, farthest_hz: float) -> None:
    """What a still contact feels of a step that leaves it still is the distance from that way."""
    for seed in range(40):
        before, after, w_um = random_step(modes, farthest_hz, seed)
        way, scale_um = after - before, float(np.abs(after - before).max())
        outside = np.flatnonzero(np.abs(w_um - after).max(axis=1) > SETTLED_FRAC * scale_um)
        assert 1e3 / CONTROL_HZ * (outside[-1] + 2) <= MOST_MS
        along = (w_um - before) @ way.conj() / np.vdot(way, way).real
        beside_um = np.abs(w_um - before - along[:, np.newaxis].real * way).max()
        assert beside_um <= OFF_THE_WAY_UM[farthest_hz]
