"""Penalised least squares over a plate by products of Legendre polynomials, weighted by cross validation.

Sources: P. Craven and G. Wahba, Numer. Math. 31 (1979) 377 (generalised cross validation); G. Wahba, Spline Models
for Observational Data, ch. 4 (penalties made from a differential operator).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..values import FloatArray
from . import legendre

Order = tuple[int, int]  # of the derivatives along x and along y

_FLOOR = 1e-9  # keeps the normal equations definite in directions that neither data nor penalty constrain
_WEIGHTS = np.logspace(-6.0, 5.0, 133)  # a twelfth of a decade apart: finer than cross validation resolves


class PlateBasis:
    """Products of Legendre polynomials with i / degrees[0] + j / degrees[1] <= 1, over a plate of 2 `half_mm`.

    High degrees in both directions are left out: no wave that the axes resolve needs them.
    """

    def __init__(self, degrees: tuple[int, int], half_mm: tuple[float, float]) -> None:
        self.degrees, self.half_mm = degrees, half_mm
        i, j = np.indices((degrees[0] + 1, degrees[1] + 1))
        kept = i * degrees[1] + j * degrees[0] <= degrees[0] * degrees[1]
        self._i, self._j = i[kept], j[kept]

    def at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return all products at points (N,), (N,): (N, products)."""
        along_x, along_y = self._along(0, x_mm, 0), self._along(1, y_mm, 0)
        return np.asarray(along_x[:, self._i] * along_y[:, self._j])

    def on_grid(
        self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray, order: Order = (0, 0)
    ) -> FloatArray:
        """Return a partial derivative, per mm, of the surfaces `coefficients` (products, M) on a grid: (M, ny, nx)."""
        table = np.zeros((coefficients.shape[1], self.degrees[1] + 1, self.degrees[0] + 1))
        table[:, self._j, self._i] = coefficients.T
        return np.asarray(self._along(1, y_mm, order[1]) @ table @ self._along(0, x_mm, order[0]).T)

    def energy(self, left: Order, right: Order) -> FloatArray:
        """Return four times the mean over the plate of products of two partial derivatives (products, products)."""
        along_x, along_y = (
            legendre.overlap(self.degrees[axis], left[axis], right[axis])
            / self.half_mm[axis] ** (left[axis] + right[axis])
            for axis in (0, 1)
        )
        return np.asarray(along_x[np.ix_(self._i, self._i)] * along_y[np.ix_(self._j, self._j)])

    def _along(self, axis: int, position_mm: FloatArray, order: int) -> FloatArray:
        half_mm = self.half_mm[axis]
        return legendre.values(position_mm / half_mm, self.degrees[axis], order) / half_mm**order


@dataclass(frozen=True, slots=True)
class Smoothed:
    """M fitted surfaces `coefficients` (products, M), the number of parameters that the data determine, `freedom` (M,),
    and data minus fit, `residual` (N, M)."""

    coefficients: FloatArray
    freedom: FloatArray
    residual: FloatArray

    @property
    def residual_rms(self) -> FloatArray:
        """RMS of the residual of each surface, (M,)."""
        return np.asarray(np.sqrt((self.residual**2).mean(axis=0)), np.float64)

    @property
    def noise_rms(self) -> FloatArray:
        """The data's noise, estimated from residual and freedom, (M,)."""
        return self.residual_rms / np.sqrt(self._spare_frac)

    @property
    def prediction_rms(self) -> FloatArray:
        """Expected error at new data: square root of the generalised cross validation, (M,)."""
        return self.residual_rms / self._spare_frac

    @property
    def _spare_frac(self) -> FloatArray:
        points = len(self.residual)
        return np.maximum(1.0 - self.freedom / points, 1.0 / points)


class ScatteredData:
    """M values at each of N points of a plate, `values` (N, M), and their normal equations."""

    def __init__(self, basis: PlateBasis, x_mm: FloatArray, y_mm: FloatArray, values: FloatArray) -> None:
        self._values = values
        self._design = basis.at(x_mm, y_mm)
        self._normal = self._design.T @ self._design * (4.0 / len(values))
        self._right = self._design.T @ values * (4.0 / len(values))

    def smooth(self, penalty: FloatArray) -> Smoothed:
        """Minimise mean square misfit + weight * penalty, with each surface's own weight by cross validation.

        Normal equations and penalty are diagonalised together, so that all weights cost one decomposition.
        """
        points, surfaces = self._values.shape
        root = np.linalg.cholesky(self._normal + penalty + _FLOOR * np.eye(len(penalty)))
        half = np.linalg.solve(root, self._normal)
        seen, axes = np.linalg.eigh(np.linalg.solve(root, half.T))
        seen = np.clip(seen, 0.0, 1.0)  # 1: determined by the data alone; 0: by the penalty alone
        directions = np.linalg.solve(root.T, axes)
        loads = directions.T @ self._right
        damped = seen + _WEIGHTS[:, None] * (1.0 - seen)  # (weights, products)
        answers = loads / damped[:, :, None]  # (weights, products, M)
        explained = np.einsum("wpm,wpm->wm", answers, 2.0 * loads - answers * seen[:, None])
        misfit = 4.0 * (self._values**2).mean(axis=0) - explained
        freedom = (seen / damped).sum(axis=1)
        spare_frac = np.maximum(1.0 - freedom / points, 1.0 / points)
        best = np.argmin(misfit / spare_frac[:, None] ** 2, axis=0)
        coefficients = directions @ answers[best, :, np.arange(surfaces)].T
        return Smoothed(coefficients, freedom[best], self._values - self._design @ coefficients)


def third_derivatives(basis: PlateBasis, wave_rad_mm: float) -> FloatArray:
    """Return the penalty on squared third derivatives in units of `wave_rad_mm`^3 w."""
    penalty = np.zeros_like(basis.energy((0, 0), (0, 0)))
    for n in range(4):
        penalty += basis.energy((n, 3 - n), (n, 3 - n)) * (math.comb(3, n) / wave_rad_mm**6)
    return penalty


def plate_equation(basis: PlateBasis, wave_rad_mm: float) -> FloatArray:
    """Return the penalty on (lap lap w - k^4 w)^2 in units of k^4 w with k = `wave_rad_mm`."""
    terms = (((4, 0), 1.0), ((2, 2), 2.0), ((0, 4), 1.0), ((0, 0), -(wave_rad_mm**4)))
    penalty = np.zeros_like(basis.energy((0, 0), (0, 0)))
    for left, factor_left in terms:
        for right, factor_right in terms:
            penalty += basis.energy(left, right) * (factor_left * factor_right / wave_rad_mm**8)
    return penalty
