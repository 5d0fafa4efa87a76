"""Departures of the true mode shapes from a free plate's: functions that no fit of the daemon's contains.

Waves of other lengths than the plate's own in random directions, and cusps. Each mode and each purpose has a random
stream of its own.
"""

from __future__ import annotations

import numpy as np

from ...values import FloatArray

GLUE, CHANGE = 1, 2  # purposes: present at the scan, and since
_WAVES = 12
_LENGTHS_MM = (18.0, 50.0)  # the plates' own waves: 27 and 32 mm
_CUSPS = 3
_CUSP_MM = (6.0, 15.0)  # in which a cusp falls to 1/e
_NORM_POINTS = 101


def waves(x_mm: FloatArray, y_mm: FloatArray, size_mm: tuple[float, float], stream: tuple[int, int, int]) -> FloatArray:
    """Return other waves (ny, nx) with an RMS of 1 over the plate; `stream` is seed, purpose and mode."""
    random = np.random.default_rng([*stream, 0])
    wave_rad_mm = 2.0 * np.pi / random.uniform(*_LENGTHS_MM, _WAVES)
    turn_rad, phase_rad = random.uniform(0.0, 2.0 * np.pi, (2, _WAVES))
    kx, ky = wave_rad_mm * np.cos(turn_rad), wave_rad_mm * np.sin(turn_rad)

    def summed(x: FloatArray, y: FloatArray) -> FloatArray:
        along_x = np.exp(1j * (np.outer(kx, x) + phase_rad[:, None]))
        return np.asarray(np.einsum("wy,wx->yx", np.exp(1j * np.outer(ky, y)), along_x).real)

    edges = [np.linspace(-edge_mm / 2.0, edge_mm / 2.0, _NORM_POINTS) for edge_mm in size_mm]
    rms = float(np.sqrt(np.mean(summed(*edges) ** 2)))
    return summed(x_mm, y_mm) / rms


def cusps(x_mm: FloatArray, y_mm: FloatArray, size_mm: tuple[float, float], stream: tuple[int, int, int]) -> FloatArray:
    """Return some cusps (ny, nx) of height 1 and either sign at random places."""
    random = np.random.default_rng([*stream, 1])
    total = np.zeros((len(y_mm), len(x_mm)))
    for _ in range(_CUSPS):
        at_x_mm, at_y_mm = random.uniform(-0.5, 0.5, 2) * size_mm
        far_mm = np.hypot(x_mm - at_x_mm, (y_mm - at_y_mm)[:, None])
        total += random.choice((-1.0, 1.0)) * np.exp(-far_mm / random.uniform(*_CUSP_MM))
    return total
