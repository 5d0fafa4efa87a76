"""Steps of two to eight modes at once, from one random feasible reference to another, under the amplifiers' limits.

What a still contact feels of a step that leaves it still is the distance from the straight way, between ticks too.
"""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.board.board import Board, BoardConfig, BoardTrace
from hapticd.sim.board.closed_loop import LIMIT_V, NOISE_UM, SETTLED_FRAC, step_trace
from hapticd.values import ComplexArray

from .bench import nominal_plate

DECAY_1_S, DELAY_S = 183.0, 50e-6  # from the end of a tick to its voltage: a chunk
OFF_THE_WAY_UM = {  # by ticks a second, and by how far modes may be from the drive, Hz: at ticks, and between them
    (5000, 150.0): (0.01, 0.013),
    (5000, 300.0): (0.035, 0.048),
    (2000, 150.0): (0.03, 0.08),
    (2000, 300.0): (0.105, 0.3),
}
MOST_MS, SHARE = {5000: 6.0, 2000: 7.0}, 0.5  # of what the voltage holds of each mode
INSTANTS = 20  # of a tick


class Step:
    """References before and after, and the board's trace from two ticks before the step on."""

    def __init__(self, modes: int, control_hz: int, farthest_hz: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        detuning_rad_s = 2 * np.pi * random.uniform(-farthest_hz, farthest_hz, modes)
        held_um = random.uniform(1.5, 3.0, modes)
        self.gain_um_per_v_s = held_um * np.hypot(DECAY_1_S, detuning_rad_s) / LIMIT_V
        self.rate_1_s: ComplexArray = -DECAY_1_S + 1j * detuning_rad_s
        self.tick_s = 1 / control_hz
        config = BoardConfig(
            control_hz=control_hz,
            decay_1_s=(DECAY_1_S,) * modes,
            detuning_rad_s=tuple(detuning_rad_s),
            gain_um_per_v_s=tuple(self.gain_um_per_v_s),
            loop_phase_rad=(0.0,) * modes,
            w_limit_um=(4.0,) * modes,
        )
        board = Board(nominal_plate(config, noise_um=NOISE_UM), config=config)
        self.before, self.after = (SHARE * held_um * random.uniform(-1, 1, modes) + 0j for _ in range(2))
        self.trace: BoardTrace = step_trace(board, self.before, self.after)
        self.begins = len(self.trace) // 2

    def _moved(self, w_um: ComplexArray, voltage_v: ComplexArray, span_s: float) -> ComplexArray:
        """The plate in closed form, a span later under that voltage: firmware/core/plant.h."""
        kept = np.exp(self.rate_1_s * span_s)
        return kept * w_um - 1j * self.gain_um_per_v_s * voltage_v * (kept - 1) / self.rate_1_s

    def at_ticks_um(self) -> ComplexArray:
        """(ticks, modes)."""
        return self.trace.plate_um[self.begins :]

    def between_um(self) -> ComplexArray:
        """(ticks, INSTANTS, modes): an old voltage until the chunk is over, then the new one."""
        w_um, v = self.trace.plate_um[self.begins : -1], self.trace.voltage_v
        old_v, new_v = v[self.begins - 1 : -2], v[self.begins : -1]
        taken_over_um = self._moved(w_um, old_v, DELAY_S)
        ends_um = self._moved(taken_over_um, new_v, self.tick_s - DELAY_S)
        assert np.abs(ends_um - self.trace.plate_um[self.begins + 1 :]).max() <= 1e-4, "as the simulated plate moved"
        return np.stack(
            [
                self._moved(w_um, old_v, t_s) if t_s <= DELAY_S else self._moved(taken_over_um, new_v, t_s - DELAY_S)
                for t_s in self.tick_s / INSTANTS * np.arange(INSTANTS)
            ],
            axis=1,
        )

    def beside_um(self, w_um: ComplexArray) -> float:
        """The largest distance of one mode from the straight way."""
        way = self.after - self.before
        along = (w_um - self.before) @ way.conj() / np.vdot(way, way).real
        return float(np.abs(w_um - self.before - along[..., np.newaxis].real * way).max())


@pytest.mark.parametrize(("control_hz", "farthest_hz"), OFF_THE_WAY_UM)
@pytest.mark.parametrize("modes", range(2, 9))
def test_all_modes_settle_in_time_on_a_straight_way(modes: int, control_hz: int, farthest_hz: float) -> None:
    at_ticks_um, between_um = OFF_THE_WAY_UM[control_hz, farthest_hz]
    for seed in range(40):
        taken = Step(modes, control_hz, farthest_hz, seed)
        w_um, scale_um = taken.at_ticks_um(), float(np.abs(taken.after - taken.before).max())
        outside = np.flatnonzero(np.abs(w_um - taken.after).max(axis=1) > SETTLED_FRAC * scale_um)
        assert 1e3 / control_hz * (outside[-1] + 2) <= MOST_MS[control_hz]
        assert taken.beside_um(w_um) <= at_ticks_um
        assert taken.beside_um(taken.between_um()) <= between_um
