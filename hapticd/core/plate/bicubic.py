"""Bicubic spline surfaces through a grid: one polynomial per cell, twice continuously differentiable.

Cells may differ in size. Ends are "not-a-knot": the first two and the last two cells of a line share one cubic. Natural
ends, whose curvature is zero, err up to ten times more at an edge (plate waves, 2.25 mm step), where a free plate moves
most.

Source: C. de Boor, A Practical Guide to Splines, ch. IV (slopes, not-a-knot) and ch. XVII (tensor products).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...values import FloatArray

COEFFICIENTS = 16  # of one surface in one cell, powers of y fastest

_FILL_STEPS = 500  # far more than scattered gaps need; a gap too wide to converge is still filled smoothly


class BicubicSurfaces:
    """M surfaces over one rectangular grid, evaluated many points at a time.

    `patches` (cells, M, 16) are the coefficients for single points (`BicubicPatch`): cells row by row from the lowest
    y; for each surface the powers x^c y^d, y fastest, of the distances to the cell's lower left corner.
    """

    def __init__(self, x_knots: FloatArray, y_knots: FloatArray, values: FloatArray) -> None:
        """Interpolate `values` (M, ny, nx), all finite, over increasing knots (nx,), (ny,), at least 4 of each."""
        self.x_knots, self.y_knots = x_knots, y_knots
        along_x = np.einsum("icn,myn->myic", _cell_operator(x_knots), values, optimize=True)
        patches = np.einsum("jdn,mnic->djcim", _cell_operator(y_knots), along_x, optimize=True)
        # patches is (y^d, rows, x^c, columns, M). The coefficients of one cell are contiguous: a tick reads them with a
        # cold cache. Python floats would take four times the memory.
        by_cell = np.ascontiguousarray(patches.transpose(1, 3, 4, 2, 0))
        by_cell.setflags(write=False)
        self.patches = by_cell.reshape(-1, values.shape[0], COEFFICIENTS)
        self._by_power = self.patches.reshape(-1, values.shape[0], 4, 4).transpose(3, 2, 0, 1)

    def evaluate(self, points: FloatArray) -> FloatArray:
        """Return values (N, M) at `points` (N, 2); points outside are clamped to the edge, NaN gives zeros."""
        cell, u, v = self._locate(points)
        value = self._row(3, cell, u)
        for power in (2, 1, 0):
            value = value * v + self._row(power, cell, u)
        return _silence_nan(value, points)

    def gradient(self, points: FloatArray) -> FloatArray:
        """Return the derivatives (N, M, 2) of `evaluate` along x and y; outside, those across the edge are zero."""
        cell, u, v = self._locate(points)
        along_x = self._row_slope(3, cell, u)
        for power in (2, 1, 0):
            along_x = along_x * v + self._row_slope(power, cell, u)
        along_y = 3.0 * self._row(3, cell, u) * v + 2.0 * self._row(2, cell, u)
        along_y = along_y * v + self._row(1, cell, u)
        held = np.column_stack((_outside(points[:, 0], self.x_knots), _outside(points[:, 1], self.y_knots)))
        return _silence_nan(np.where(held[:, None, :], 0.0, np.stack((along_x, along_y), axis=-1)), points)

    def _locate(self, points: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray, FloatArray]:
        """The cell of each point (N,), and its offsets (N, 1) from the cell's lower left corner."""
        x = np.clip(points[:, 0], self.x_knots[0], self.x_knots[-1])
        y = np.clip(points[:, 1], self.y_knots[0], self.y_knots[-1])
        column = np.searchsorted(self.x_knots[1:-1], x, side="right")
        row = np.searchsorted(self.y_knots[1:-1], y, side="right")
        offsets = (x - self.x_knots[column])[:, None], (y - self.y_knots[row])[:, None]
        return row * (self.x_knots.size - 1) + column, *offsets

    def _row(self, power: int, cell: npt.NDArray[np.intp], u: FloatArray) -> FloatArray:
        """The cubic in x that multiplies y^power, (N, M)."""
        c0, c1, c2, c3 = self._by_power[power]
        value: FloatArray = ((c3[cell] * u + c2[cell]) * u + c1[cell]) * u + c0[cell]
        return value

    def _row_slope(self, power: int, cell: npt.NDArray[np.intp], u: FloatArray) -> FloatArray:
        _, c1, c2, c3 = self._by_power[power]
        slope: FloatArray = (3.0 * c3[cell] * u + 2.0 * c2[cell]) * u + c1[cell]
        return slope


class BicubicPatch:
    """One surface in one cell, for single points: attributes, which are plain doubles as machine code.

    `u`, `v` are the distances to the cell's lower left corner.
    """

    def __init__(self, coefficients: Sequence[float]) -> None:
        self._a0, self._b0, self._c0, self._d0 = coefficients[0:4]
        self._a1, self._b1, self._c1, self._d1 = coefficients[4:8]
        self._a2, self._b2, self._c2, self._d2 = coefficients[8:12]
        self._a3, self._b3, self._c3, self._d3 = coefficients[12:16]

    def value(self, u: float, v: float) -> float:
        """Return the value at one point."""
        a = ((self._a3 * u + self._a2) * u + self._a1) * u + self._a0
        b = ((self._b3 * u + self._b2) * u + self._b1) * u + self._b0
        c = ((self._c3 * u + self._c2) * u + self._c1) * u + self._c0
        d = ((self._d3 * u + self._d2) * u + self._d1) * u + self._d0
        return ((d * v + c) * v + b) * v + a

    def slope(self, u: float, v: float) -> tuple[float, float, float]:
        """Return the value and the derivatives along x and y."""
        a1, a2, a3 = self._a1, self._a2, self._a3
        b1, b2, b3 = self._b1, self._b2, self._b3
        c1, c2, c3 = self._c1, self._c2, self._c3
        d1, d2, d3 = self._d1, self._d2, self._d3
        a, a_x = ((a3 * u + a2) * u + a1) * u + self._a0, (3.0 * a3 * u + 2.0 * a2) * u + a1
        b, b_x = ((b3 * u + b2) * u + b1) * u + self._b0, (3.0 * b3 * u + 2.0 * b2) * u + b1
        c, c_x = ((c3 * u + c2) * u + c1) * u + self._c0, (3.0 * c3 * u + 2.0 * c2) * u + c1
        d, d_x = ((d3 * u + d2) * u + d1) * u + self._d0, (3.0 * d3 * u + 2.0 * d2) * u + d1
        return ((d * v + c) * v + b) * v + a, ((d_x * v + c_x) * v + b_x) * v + a_x, (3.0 * d * v + 2.0 * c) * v + b


def fill_gaps(x_knots: FloatArray, y_knots: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (M, ny, nx) with every NaN replaced by the smoothest interpolation.

    Minimises the sum of the squared fourth differences along both axes (conjugate gradients). At 6 points per
    wavelength the error of a lost point is 1 % of the peak RMS inside the map, 6 % on its border. Meant for a few lost
    points: `design.fit_cartography` uses the whole map instead.
    """
    rough_x, rough_y = _roughness(x_knots), _roughness(y_knots)
    return np.stack([_fill_surface(surface, rough_x, rough_y) for surface in values])


def _fill_surface(surface: FloatArray, rough_x: FloatArray, rough_y: FloatArray) -> FloatArray:
    gap = np.isnan(surface)
    filled = np.where(gap, 0.0, surface)
    residual = -np.where(gap, filled @ rough_x + rough_y @ filled, 0.0)
    direction, energy = residual, float(np.vdot(residual, residual))
    goal = 1e-20 * energy
    for _ in range(_FILL_STEPS):
        image = np.where(gap, direction @ rough_x + rough_y @ direction, 0.0)
        bend = float(np.vdot(direction, image))
        if not (energy > goal and bend > 0.0):
            break
        step = energy / bend
        filled, residual = filled + step * direction, residual - step * image
        energy, last = float(np.vdot(residual, residual)), energy
        direction = residual + energy / last * direction
    return filled


def _roughness(knots: FloatArray) -> FloatArray:
    """Matrix R with z R z = sum of squared fourth (on 4 knots, third) differences of z along one line."""
    order = min(4, knots.size - 1)
    difference: FloatArray = np.eye(knots.size)
    for n in range(1, order + 1):
        # Divided differences, scaled so that equal steps give the plain ones.
        span = (knots[n:] - knots[:-n]) / (n * float(np.mean(np.diff(knots))))
        difference = np.diff(difference, axis=0) / span[:, None]
    roughness: FloatArray = difference.T @ difference
    return roughness


def _cell_operator(knots: FloatArray) -> FloatArray:
    """(n-1, 4, n): from values on the knots to each interval's cubic, in powers of the distance to its left knot."""
    width = np.diff(knots)
    secant = np.diff(np.eye(knots.size), axis=0) / width[:, None]
    slope = _slope_operator(width, secant)
    left, right = slope[:-1], slope[1:]
    square = (3.0 * secant - 2.0 * left - right) / width[:, None]
    cube = (left + right - 2.0 * secant) / (width * width)[:, None]
    return np.stack((np.eye(knots.size)[:-1], left, square, cube), axis=1)


def _slope_operator(width: FloatArray, secant: FloatArray) -> FloatArray:
    """(n, n): from values to the slopes that make second (at the outer cells also third) derivatives continuous."""
    n = width.size + 1
    system, right = np.zeros((n, n)), np.zeros((n, n))
    for k in range(1, n - 1):
        before, after = width[k - 1], width[k]
        system[k, k - 1 : k + 2] = after, 2.0 * (before + after), before
        right[k] = 3.0 * (after * secant[k - 1] + before * secant[k])
    system[0, :2], right[0] = _end_row(width[0], width[1], secant[0], secant[1])
    system[-1, :-3:-1], right[-1] = _end_row(width[-1], width[-2], secant[-1], secant[-2])
    return np.asarray(np.linalg.solve(system, right), np.float64)


def _end_row(
    outer: float, inner: float, outer_secant: FloatArray, inner_secant: FloatArray
) -> tuple[tuple[float, float], FloatArray]:
    both = outer + inner
    return (inner, both), ((outer + 2.0 * both) * inner * outer_secant + outer * outer * inner_secant) / both


def _outside(coordinate: FloatArray, knots: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray((coordinate < knots[0]) | (coordinate > knots[-1]), np.bool_)


def _silence_nan(values: FloatArray, points: FloatArray) -> FloatArray:
    """Set values to zero where a coordinate is NaN: no amplitude is the safe answer for an unknown position."""
    values[np.isnan(points).any(axis=1)] = 0.0
    return values
