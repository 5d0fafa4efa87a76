"""Waves that a mode map may lack: surfaces that obey the plate equation of the map's own wavelength."""

from __future__ import annotations

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ..legendre import FloatArray
from ..smoothing import PlateBasis, plate_equation, third_derivatives

_DEGREE = 26  # per axis: waves of 27 mm on a plate of 137.5 mm need 22
_THIRD = 1e-3  # share of the third derivatives: keeps out waves that decay within a millimetre of an edge
_FREE = 0.02  # penalty at which a wave counts half


class Waves:
    """K surfaces of mean square 1 over the plate, and how far each may be from 0: `prior` (K,), in units of the first.

    They are those of a polynomial basis that obey lap lap w = k^4 w best.
    """

    def __init__(self, modes: ModeShapes, wave_rad_mm: float) -> None:
        half_mm = float(modes.x_mm[-1]), float(modes.y_mm[-1])
        self._basis = PlateBasis((_DEGREE, _DEGREE), half_mm)
        mean = self._basis.energy((0, 0), (0, 0)) / 4.0
        penalty = plate_equation(self._basis, wave_rad_mm) + _THIRD * third_derivatives(self._basis, wave_rad_mm)
        root = np.linalg.cholesky(mean)
        half = np.linalg.solve(root, penalty / 4.0)
        cost, axes = np.linalg.eigh(np.linalg.solve(root, half.T))
        weight = 1.0 / (1.0 + np.maximum(cost, 0.0) / _FREE)
        kept = weight > 0.2
        self._surfaces = np.linalg.solve(root.T, axes)[:, kept]
        self.prior: FloatArray = np.sqrt(weight[kept])

    def __len__(self) -> int:
        return len(self.prior)

    def at(self, points_mm: FloatArray) -> FloatArray:
        """Return all waves at points (N, 2): (N, K)."""
        return self._basis.at(points_mm[:, 0], points_mm[:, 1]) @ self._surfaces

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the sums of `coefficients` (M, K) on a grid: (M, ny, nx)."""
        return self._basis.on_grid(self._surfaces @ coefficients.T, x_mm, y_mm)


def wave_number(modes: ModeShapes) -> float:
    """Return k in rad/mm with lap w = -k^2 w, by regression over the inner half of the map."""
    inner = [slice(len(axis) // 5, -(len(axis) // 5)) for axis in (modes.y_mm, modes.x_mm)]
    along_y = np.gradient(np.gradient(modes.shapes, modes.y_mm, axis=1), modes.y_mm, axis=1)
    along_x = np.gradient(np.gradient(modes.shapes, modes.x_mm, axis=2), modes.x_mm, axis=2)
    shape, laplacian = modes.shapes[:, *inner], (along_x + along_y)[:, *inner]
    return float(np.sqrt(max(-np.vdot(shape, laplacian) / np.vdot(shape, shape), 1e-6)))
