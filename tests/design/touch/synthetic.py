"""Synthetic touching: two fingers on a plate of two waves, with ticks that follow the model exactly, but for noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticd.core.plate.contact import disc_points
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.design.touch.model import CENTROID, LATENCY, Calibration
from hapticd.design.touch.observations import Ticks, Track, Windows, in_windows
from hapticd.values import ComplexArray, FloatArray

WAVE_RAD_MM = 0.23
TICK_HZ, REPORT_HZ = 400.0, 90.0
DECAY_1_S = np.array((180.0, 190.0))
DETUNING_RAD_S = np.array((-60.0, 60.0))
GAIN_UM_PER_V_S = 7.5


def shapes_at(points_mm: FloatArray) -> FloatArray:
    """Two standing waves (..., 2) at points (..., 2)."""
    x, y = WAVE_RAD_MM * points_mm[..., 0], WAVE_RAD_MM * points_mm[..., 1]
    return np.stack(
        (np.cos(x) * (1.0 + 0.2 * np.cos(0.3 * y)), np.sin(y + 0.4) * (1.0 - 0.2 * np.sin(0.3 * x))), axis=-1
    )


def mode_map() -> ModeShapes:
    """The same on a grid."""
    axis = np.linspace(-70.0, 70.0, 81)
    return ModeShapes(axis, axis, np.moveaxis(shapes_at(np.stack(np.meshgrid(axis, axis), axis=-1)), -1, 0))


@dataclass(frozen=True)
class Touching:
    """What is true of a synthetic touching; `at_rest` fingers lie still, `fingers` of them, each a disc of its radius,
    or all points."""

    truth: Calibration
    seconds: float = 12.0
    seed: int = 1
    at_rest: bool = False
    fingers: int = 2
    load_1_s: complex = 100.0
    noise_um_s: float = 1.0
    noise_mm: float = 0.02
    radii_mm: tuple[float, ...] = ()

    def path_mm(self, t_s: FloatArray) -> FloatArray:
        """Return true positions (T, N, 2)."""
        rng = np.random.default_rng(self.seed)
        centre = rng.uniform(-15.0, 15.0, (self.fingers, 2))
        rate = 2.0 * np.pi * rng.uniform(0.2, 0.5, (self.fingers, 2, 2))
        phase = rng.uniform(0.0, 6.28, (self.fingers, 2, 2))
        size_mm = 0.0 if self.at_rest else 18.0
        angle = rate * t_s[:, None, None, None] + phase
        return np.asarray(centre + size_mm * np.sin(angle).sum(axis=-1), np.float64)

    def reported_mm(self, t_s: FloatArray) -> FloatArray:
        """Return what the daemon takes the positions to be (T, N, 2), wrong as the truth says."""
        latency_s = float(self.truth.pad[LATENCY])
        ahead = self.path_mm(t_s - latency_s)
        matrix, offset_mm = self.truth.affine
        return np.asarray((ahead - offset_mm) @ np.linalg.inv(matrix).T, np.float64)

    def windows(self) -> Windows:
        """Return what the touching shows."""
        return in_windows(*self.shown(), 0.01)

    def shown(self) -> tuple[Ticks, list[Track]]:
        """Return the ticks and tracks of the touching."""
        assert self.truth.pad[CENTROID] == 0.0
        rng = np.random.default_rng(self.seed + 100)
        t_report_s = np.arange(0.0, self.seconds, 1.0 / REPORT_HZ)
        reported_mm = self.reported_mm(t_report_s)
        reported_mm = reported_mm + self.noise_mm * rng.standard_normal(reported_mm.shape)
        tracks = [Track.of(t_report_s, reported_mm[:, finger]) for finger in range(self.fingers)]
        return self.ticks(rng), tracks

    def ticks(self, rng: np.random.Generator) -> Ticks:
        """Return what the board reports."""
        t_s = np.arange(0.0, self.seconds, 1.0 / TICK_HZ)
        turning_rad_s = 2.0 * np.pi * np.array((4.3, 5.7))
        angle = turning_rad_s * t_s[:, None] + np.array((0.0, 1.0))
        modal_um: ComplexArray = 2.0 * np.exp(1j * angle) + 1.0
        modal_slope = 2j * turning_rad_s * np.exp(1j * angle)
        radii_mm = np.array(self.radii_mm or (0.0,) * self.fingers)
        dx, dy, shares = np.array(disc_points(1.0)).T
        away_mm = radii_mm[:, None, None] * np.stack((dx, dy), axis=1)
        phi = shapes_at(self.path_mm(t_s)[:, :, None] + away_mm)
        swing = 1.0 + 0.3 * np.sin(2.0 * np.pi * 0.8 * t_s)[:, None] * np.ones(self.fingers)
        felt = self.load_1_s * swing[..., None] * shares * np.einsum("tnqm,tm->tnq", phi, modal_um)
        pushed = modal_slope + (DECAY_1_S - 1j * DETUNING_RAD_S) * modal_um + np.einsum("tnq,tnqm->tm", felt, phi)
        noise = rng.standard_normal((2, *pushed.shape)) * self.noise_um_s
        voltage_v = 1j * (pushed + noise[0] + 1j * noise[1]) / GAIN_UM_PER_V_S
        inverse = np.linalg.inv(self.truth.sense)
        behind = rng.standard_normal(pushed.shape) + 1j * rng.standard_normal(pushed.shape)
        return Ticks(t_s, modal_um @ inverse.T, voltage_v, modal_slope @ inverse.T, behind, np.zeros(len(t_s)))
