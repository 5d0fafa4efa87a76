"""Mode shapes of a plate as Legendre series: their values, peaks and names."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..values import FloatArray
from . import legendre

_PEAK_GRID = 257
_EQUAL_FRAC = 0.999  # products of beam functions this close in size form one combination


@dataclass(frozen=True, eq=False)
class ModeShape:
    """A mode's deflection as products of orthonormal Legendre polynomials in 2x/width and 2y/depth, peak |shape| of 1.

    `coefficients` (nx, ny) is read-only. `nodal_lines` counts the lines crossed along x and along y by the product
    of beam functions that dominates the shape; that product is positive in the corner (+x, +y).
    A solved mode has its `motion` (4, nx, ny) per deflection at the peak: turns of the section about the plate's
    middle, in 1/mm, by which a height z moves along x and y by z times them, and the middle's own motion along x and y;
    and its `mass_kg`, of all that moves, about the deflection at the peak.
    """

    size_mm: tuple[float, float]
    coefficients: FloatArray
    nodal_lines: tuple[int, int]
    name: str
    motion: FloatArray | None = None
    mass_kg: float = math.nan

    @property
    def solved_motion(self) -> FloatArray:
        """The motion of a solved mode. Raises ValueError for another."""
        if self.motion is None:
            raise ValueError(f"of {self.name} only the deflection is known: solve its plate.")
        return self.motion

    def evaluate(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return the shape (N,) at `points_mm` (N, 2), clamped to the plate. NaN stays NaN."""
        points = np.asarray(points_mm, np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise ValueError(f"points_mm has shape {points.shape}; give (N, 2), a row per point.")
        x, y = np.clip(points * (2.0 / np.array(self.size_mm)), -1.0, 1.0).T
        terms_x, terms_y = self.coefficients.shape
        across = legendre.values(x, terms_x - 1) @ self.coefficients
        return np.asarray(np.einsum("nj,nj->n", across, legendre.values(y, terms_y - 1)))

    def on_grid(self, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike) -> FloatArray:
        """Return the shape (ny, nx) on the grid of `x_mm` (nx,), `y_mm` (ny,): much cheaper than point by point."""
        width_mm, depth_mm = self.size_mm
        x = np.clip(np.asarray(x_mm, np.float64) * (2.0 / width_mm), -1.0, 1.0)
        y = np.clip(np.asarray(y_mm, np.float64) * (2.0 / depth_mm), -1.0, 1.0)
        return _tensor(self.coefficients, x, y)


def mode_shape(size_mm: tuple[float, float], fields: FloatArray) -> ModeShape:
    """Return the shape of a mode of unit modal mass in kg: deflection, turns and the middle's motion (5, nx, ny)."""
    nodal_lines, name, sign = _dominant_product(fields[0])
    peak = _peak(fields[0])
    scaled = fields * (sign / peak)
    scaled.setflags(write=False)
    return ModeShape(size_mm, scaled[0], nodal_lines, name, scaled[1:], 1.0 / peak**2)


def distinct_names(modes: Sequence[tuple[float, ModeShape]]) -> list[str]:
    """Return the shapes' names; where several have one, those after the first end with "#2", "#3" ..."""
    seen: Counter[str] = Counter()
    names = []
    for _, shape in modes:
        seen[shape.name] += 1
        names.append(shape.name if seen[shape.name] == 1 else f"{shape.name}#{seen[shape.name]}")
    return names


def _dominant_product(coefficients: FloatArray) -> tuple[tuple[int, int], str, float]:
    """Nodal lines, name and sign, by expanding the shape in products of free-beam modes (Leissa's naming)."""
    terms_x, terms_y = coefficients.shape
    products = _beam_modes(terms_x - 1) @ coefficients @ _beam_modes(terms_y - 1).T
    size = np.abs(products)
    candidates = np.argwhere(size >= _EQUAL_FRAC * size.max()).tolist()
    i, j = max(candidates)
    name = f"{i}x{j}"
    if i != j and [j, i] in candidates:
        name += f"{'+' if products[i, j] * products[j, i] > 0.0 else '-'}{j}x{i}"
    return (i, j), name, math.copysign(1.0, float(products[i, j]))


@lru_cache(maxsize=8)
def _beam_modes(degree: int) -> FloatArray:
    """Free-beam modes (degree + 1, degree + 1) as rows of Legendre coefficients: row n has n nodes, end +1 positive."""
    bend = legendre.overlap(degree, 2, 2)
    beam = np.zeros_like(bend)
    for parity in (0, 1):
        own = slice(parity, None, 2)
        beam[own, own] = np.linalg.eigh(bend[own, own])[1].T
    at_end = beam @ legendre.values(np.ones(1), degree)[0]
    return beam * np.where(at_end < 0.0, -1.0, 1.0)[:, None]


def _peak(coefficients: FloatArray) -> float:
    """Return the largest |shape| on the plate: on a grid, then on two finer ones around the best point (to 1e-9)."""
    x = y = np.linspace(-1.0, 1.0, _PEAK_GRID)
    reach, peak = 2.0 / (_PEAK_GRID - 1), 0.0
    for _ in range(3):
        height = np.abs(_tensor(coefficients, x, y))
        row, column = np.unravel_index(int(np.argmax(height)), height.shape)
        peak = float(height[row, column])
        x, y = (np.clip(np.linspace(at - reach, at + reach, 33), -1.0, 1.0) for at in (x[column], y[row]))
        reach /= 16.0
    return peak


def _tensor(coefficients: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the shape on a grid of normalised coordinates -1 .. 1, (ny, nx)."""
    terms_x, terms_y = coefficients.shape
    result: FloatArray = legendre.values(y, terms_y - 1) @ coefficients.T @ legendre.values(x, terms_x - 1).T
    return result
