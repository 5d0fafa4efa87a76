"""Steps of two to eight modes at once, from one random feasible reference to another, under the amplifiers' limits.

What a still contact feels of a step that leaves it still is the distance from the straight way.
"""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.board.board import Board, BoardConfig
from hapticd.sim.board.closed_loop import LIMIT_V, NOISE_UM, SETTLED_FRAC
from hapticd.values import ComplexArray

from .bench import nominal_plate, step_trace

DECAY_1_S = 183.0
# By ticks a second, and by how far modes may be from the drive, Hz.
OFF_THE_WAY_UM = {(5000, 150.0): 0.01, (5000, 300.0): 0.035, (2000, 150.0): 0.03, (2000, 300.0): 0.105}
MOST_MS, SHARE = {5000: 6.0, 2000: 7.0}, 0.5  # of what the voltage holds of each mode


def stepped(modes: int, control_hz: int, farthest_hz: float, seed: int) -> tuple[ComplexArray, ...]:
    """References (modes,) before and after a step, and what the plate did from it on (ticks, modes)."""
    random = np.random.default_rng(seed)
    detuning_rad_s = 2 * np.pi * random.uniform(-farthest_hz, farthest_hz, modes)
    held_um = random.uniform(1.5, 3.0, modes)
    config = BoardConfig(
        control_hz=control_hz,
        decay_1_s=(DECAY_1_S,) * modes,
        detuning_rad_s=tuple(detuning_rad_s),
        gain_um_per_v_s=tuple(held_um * np.hypot(DECAY_1_S, detuning_rad_s) / LIMIT_V),
        loop_phase_rad=(0.0,) * modes,
        w_limit_um=(4.0,) * modes,
    )
    board = Board(nominal_plate(config, noise_um=NOISE_UM), config=config)
    before, after = (SHARE * held_um * random.uniform(-1, 1, modes) + 0j for _ in range(2))
    trace = step_trace(board, before, after)
    return before, after, trace.plate_um[len(trace) // 2 :]


@pytest.mark.parametrize(("control_hz", "farthest_hz"), OFF_THE_WAY_UM)
@pytest.mark.parametrize("modes", range(2, 9))
def test_all_modes_settle_in_time_on_a_straight_way(modes: int, control_hz: int, farthest_hz: float) -> None:
    for seed in range(12):
        before, after, w_um = stepped(modes, control_hz, farthest_hz, seed)
        way = after - before
        outside = np.flatnonzero(np.abs(w_um - after).max(axis=1) > SETTLED_FRAC * np.abs(way).max())
        assert 1e3 / control_hz * (outside[-1] + 2) <= MOST_MS[control_hz]
        along = ((w_um - before) @ way.conj() / np.vdot(way, way).real).real
        assert np.abs(w_um - before - along[:, np.newaxis] * way).max() <= OFF_THE_WAY_UM[control_hz, farthest_hz]
