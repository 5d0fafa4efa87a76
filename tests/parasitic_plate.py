"""A plate with modes outside the sweep that every amplifier moves and every sensor sees, and what sweeps of it give."""

from __future__ import annotations

import numpy as np

from hapticd.design.wiring import AmplifierSweep
from hapticd.sim.board.board import BoardConfig, PlateModel
from hapticd.sim.board.closed_loop import NOISE_UM
from hapticd.values import ComplexArray

OWN = BoardConfig()
AWAY_HZ, COUPLING = (200.0, 250.0), 0.4  # an independent plate's
NO_THROUGH = np.zeros((2, 2), np.complex128)
SWEEP_NOISE_UM_PER_V = 4e-6  # of `hapticd calibrate resonance`; 100 times as much hides these modes


def plate(away_hz: tuple[float, ...] = AWAY_HZ, through: ComplexArray = NO_THROUGH) -> PlateModel:
    """The reference plate with modes so far from the drive."""
    count = len(away_hz)
    signs = np.where(np.arange(count)[:, None] > np.arange(2), -1.0, 1.0)
    return PlateModel(
        decay_1_s=np.array([*OWN.decay_1_s, *[OWN.decay_1_s[0]] * count]),
        detuning_rad_s=np.array([*OWN.detuning_rad_s, *(2.0 * np.pi * np.array(away_hz))]),
        gain_um_per_v_s=np.vstack([np.diag(OWN.gain_um_per_v_s), COUPLING * OWN.gain_um_per_v_s[0] * signs]),
        sensor=np.hstack([np.eye(2), COUPLING * signs.T]),
        noise_um=NOISE_UM,
        amplifier_limit_v=150.0,
        through_um_per_v=through,
    )


def swept(model: PlateModel, noise: float = 1.0, half_hz: float = 150.0, points: int = 41) -> list[AmplifierSweep]:
    """Sweeps by the plate's equations, with so many times the command's noise."""
    random, offset_hz = np.random.default_rng(1), np.linspace(-half_hz, half_hz, points)
    follows_s = -1j / (model.decay_1_s - 1j * (model.detuning_rad_s - 2.0 * np.pi * offset_hz[:, None]))
    through = NO_THROUGH if model.through_um_per_v is None else model.through_um_per_v
    sweeps = []
    for k in range(2):
        parts = noise * SWEEP_NOISE_UM_PER_V * random.standard_normal((2, points, 2))
        seen = (follows_s * model.gain_um_per_v_s[:, k]) @ model.sensor.T + through[:, k]
        sweeps.append(AmplifierSweep(k, OWN.drive_hz + offset_hz, seen + parts[0] + 1j * parts[1]))
    return sweeps
