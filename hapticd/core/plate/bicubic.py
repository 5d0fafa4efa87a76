"""Bicubic spline surfaces through a grid: one polynomial per cell, twice continuously differentiable.

Cells may differ in size. Ends are "not-a-knot": the first two and the last two cells of a line share one cubic. Natural
ends, whose curvature is zero, err up to ten times more at an edge (plate waves, 2.25 mm step), where a free plate moves
most.

Source: C. de Boor, A Practical Guide to Splines, ch. IV (slopes, not-a-knot) and ch. XVII (tensor products).
"""

from __future__ import annotations

import numpy as np

from ...values import FloatArray
from .splines import evaluate

POINT = np.array([(0.0, 0.0, 1.0)])  # of the unit disc: its centre

_FILL_STEPS = 500  # far more than scattered gaps need; a gap too wide to converge is still filled smoothly


class BicubicSurfaces:
    """M surfaces over one rectangular grid, evaluated many points at a time.

    `tables` is what `splines.c` takes: views of the coefficients (cells, M, 16), and of the knots along x and y. Cells
    are row by row from the lowest y; a surface has the powers x^c y^d, y fastest, of the distances to the cell's lower
    left corner.
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
        x_knots, y_knots = np.ascontiguousarray(x_knots, np.float64), np.ascontiguousarray(y_knots, np.float64)
        self._surfaces = values.shape[0]
        self.tables = by_cell.data, x_knots.data, y_knots.data

    def evaluate(self, points: FloatArray) -> FloatArray:
        """Return values (N, M) at `points` (N, 2); points outside are clamped to the edge, NaN gives zeros."""
        return self._at(points, has_slopes=False)[..., 0]

    def gradient(self, points: FloatArray) -> FloatArray:
        """Return the derivatives (N, M, 2) of `evaluate` along x and y; outside, those across the edge are zero."""
        return self._at(points, has_slopes=True)[..., 1:]

    def _at(self, points: FloatArray, *, has_slopes: bool) -> FloatArray:
        """Values, and slopes, (N, M, 1 or 3)."""
        places = np.ascontiguousarray(points, np.float64)
        found = np.frombuffer(bytearray(evaluate(self.tables, POINT, places, None, 0.0, has_slopes)))
        return found.reshape(len(points), self._surfaces, 3 if has_slopes else 1)


def fill_gaps(x_knots: FloatArray, y_knots: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (M, ny, nx) with every NaN replaced by the smoothest interpolation.

    Minimises the sum of the squared fourth differences along both axes (conjugate gradients). At 6 points per
    wavelength the error of a lost point is 1 % of the peak RMS inside the map, 6 % on its border. Meant for a few lost
    points: `design.fit_scan` uses the whole map instead.
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
