"""Ways from a map to the mode matrix: each gives M shapes at points, most also their gradients in the same pass.

All but scipy's are written as `ModeShapes.at` is, in plain floats with coefficients looked up by cell. Quintic splines
are built by scipy (their not-a-knot ends too) and only evaluated here. The analytic basis sums the Legendre products
of the free-plate modes that the fit found: no map at all.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from ..core.plate.mode_shapes import ModeShapes

FloatArray = npt.NDArray[np.float64]
Points = Sequence[tuple[float, float]]
Shapes = Callable[[Points], Any]  # points -> (N, M), in whatever form it comes


class Way(NamedTuple):
    """Values, and (value, slope along x, slope along y) in one go where the way has slopes; (N, M, 3)."""

    shapes: Shapes
    with_gradient: Shapes | None = None


def ways(modes: ModeShapes, interpolate: Any | None) -> dict[str, Way]:
    """All ways to read a map, by name; scipy's only where its module `interpolate` is given."""
    at, both, evaluate, gradient = modes.at, modes.at_with_gradient, modes.evaluate, modes.gradient
    linear = _Bilinear(modes)
    found = {
        "nearest": Way(_each(_Nearest(modes).at)),
        "bilinear": Way(_each(linear.at), _each(linear.at_with_gradient)),
        "bicubic at": Way(_each(at), _each(both)),
        "bicubic evaluate": Way(
            evaluate, lambda points: np.concatenate((evaluate(points)[..., None], gradient(points)), axis=-1)
        ),
    }
    if interpolate is not None:
        quintic = _Quintic(modes, interpolate)
        found["quintic"] = Way(_each(quintic.at), _each(quintic.at_with_gradient))
        found["RectBivariateSpline"] = _fitpack(modes, interpolate, 3)
        found["RectBivariateSpline, quintic"] = _fitpack(modes, interpolate, 5)
    return found


def analytic(coefficients: Sequence[FloatArray], half_mm: tuple[float, float]) -> Way:
    """Sums of orthonormal Legendre products (nx, ny), one for each mode, as `design.ModeShape` has them."""
    table = np.stack(coefficients)
    table = table * np.sqrt(np.arange(table.shape[1]) + 0.5)[:, None] * np.sqrt(np.arange(table.shape[2]) + 0.5)
    both = np.stack((table, _slope(table, 1) / half_mm[0], _slope(table, 2) / half_mm[1]))
    degree_x, degree_y = table.shape[1] - 1, table.shape[2] - 1

    def products(points: Points) -> tuple[FloatArray, FloatArray]:
        x, y = (np.asarray(points) / half_mm).T
        return legendre.legvander(x, degree_x), legendre.legvander(y, degree_y)

    def shapes(points: Points) -> FloatArray:
        along_x, along_y = products(points)
        return np.asarray(np.einsum("mnj,nj->nm", along_x @ table, along_y))

    def with_gradient(points: Points) -> FloatArray:
        along_x, along_y = products(points)
        return np.asarray(np.einsum("kmnj,nj->nmk", along_x @ both, along_y))

    return Way(shapes, with_gradient)


def _slope(table: FloatArray, axis: int) -> FloatArray:
    """The derivative's coefficients, in a table of the same size."""
    slope = legendre.legder(table, axis=axis)
    return np.concatenate((slope, np.zeros_like(table.take([0], axis))), axis)


def _each(at: Callable[[float, float], Any]) -> Shapes:
    return lambda points: [at(x, y) for x, y in points]


def _fitpack(modes: ModeShapes, interpolate: Any, degree: int) -> Way:
    splines = [
        interpolate.RectBivariateSpline(modes.y_mm, modes.x_mm, shape, kx=degree, ky=degree) for shape in modes.shapes
    ]

    def with_gradient(points: Points) -> FloatArray:
        x, y = np.asarray(points).T
        values = [[spline.ev(y, x), spline.ev(y, x, dy=1), spline.ev(y, x, dx=1)] for spline in splines]
        return np.transpose(values, (2, 0, 1))

    def shapes(points: Points) -> FloatArray:
        x, y = np.asarray(points).T
        return np.transpose([spline.ev(y, x) for spline in splines])

    return Way(shapes, with_gradient)


class _Grid:
    """Which cell of the map a point is in, and where in it."""

    def __init__(self, modes: ModeShapes) -> None:
        self._x, self._y = modes.x_mm.tolist(), modes.y_mm.tolist()

    def _cell(self, x_mm: float, y_mm: float) -> tuple[int, float, float]:
        x, y = self._x, self._y
        column = bisect_right(x, x_mm, 1, len(x) - 1) - 1
        row = bisect_right(y, y_mm, 1, len(y) - 1) - 1
        return row * (len(x) - 1) + column, x_mm - x[column], y_mm - y[row]


class _Nearest(_Grid):
    """The nearest knot's value."""

    def __init__(self, modes: ModeShapes) -> None:
        super().__init__(modes)
        self._half = ((self._x[1] - self._x[0]) / 2.0, (self._y[1] - self._y[0]) / 2.0)
        values = [[tuple(point) for point in row] for row in np.moveaxis(modes.shapes, 0, -1).tolist()]
        self._corners = [
            (low[k], low[k + 1], high[k], high[k + 1]) for low, high in pairwise(values) for k in range(len(low) - 1)
        ]

    def at(self, x_mm: float, y_mm: float) -> tuple[float, ...]:
        cell, u, v = self._cell(x_mm, y_mm)
        return self._corners[cell][(u >= self._half[0]) + 2 * (v >= self._half[1])]


class _Bilinear(_Grid):
    """a + b u + c v + d u v in each cell."""

    def __init__(self, modes: ModeShapes) -> None:
        super().__init__(modes)
        width, height = np.diff(modes.x_mm), np.diff(modes.y_mm)[:, None]
        values = modes.shapes
        a = values[:, :-1, :-1]
        b = (values[:, :-1, 1:] - a) / width
        c = (values[:, 1:, :-1] - a) / height
        d = ((values[:, 1:, 1:] - values[:, 1:, :-1]) / width - b) / height
        table = np.stack((a, b, c, d), axis=-1).reshape(modes.M, -1, 4).swapaxes(0, 1)
        self._cells = [tuple([tuple(surface) for surface in cell]) for cell in table.tolist()]

    def at(self, x_mm: float, y_mm: float) -> list[float]:
        cell, u, v = self._cell(x_mm, y_mm)
        return [(d * v + b) * u + c * v + a for a, b, c, d in self._cells[cell]]

    def at_with_gradient(self, x_mm: float, y_mm: float) -> list[tuple[float, float, float]]:
        cell, u, v = self._cell(x_mm, y_mm)
        return [((d * v + b) * u + c * v + a, d * v + b, d * u + c) for a, b, c, d in self._cells[cell]]


class _Quintic(_Grid):
    """A polynomial of degree 5 by 5 in each cell: 36 coefficients, six rows of powers of x, for each shape."""

    def __init__(self, modes: ModeShapes, interpolate: Any) -> None:
        super().__init__(modes)
        along_x, along_y = (_taylor(knots, interpolate) for knots in (modes.x_mm, modes.y_mm))
        table = np.einsum("jdn,icl,mnl->jimdc", along_y, along_x, modes.shapes, optimize=True)
        table = table.reshape(-1, modes.M, 6, 6)[:, :, ::-1, ::-1]  # highest powers first, as Horner wants them
        self._cells = [tuple([tuple(map(tuple, surface)) for surface in cell]) for cell in table.tolist()]

    def at(self, x_mm: float, y_mm: float) -> list[float]:
        cell, u, v = self._cell(x_mm, y_mm)
        phi = []
        for surface in self._cells[cell]:
            value = 0.0
            for f, e, d, c, b, a in surface:
                value = value * v + (((((f * u + e) * u + d) * u + c) * u + b) * u + a)
            phi.append(value)
        return phi

    def at_with_gradient(self, x_mm: float, y_mm: float) -> list[tuple[float, float, float]]:
        cell, u, v = self._cell(x_mm, y_mm)
        slopes = []
        for surface in self._cells[cell]:
            value = along_x = along_y = 0.0
            for f, e, d, c, b, a in surface:
                along_y = along_y * v + value
                value = value * v + (((((f * u + e) * u + d) * u + c) * u + b) * u + a)
                along_x = along_x * v + ((((5.0 * f * u + 4.0 * e) * u + 3.0 * d) * u + 2.0 * c) * u + b)
            slopes.append((value, along_x, along_y))
        return slopes


def _taylor(knots: FloatArray, interpolate: Any) -> FloatArray:
    """(n-1, 6, n): from values on the knots to each interval's quintic, in powers of the distance to its left knot."""
    spline = interpolate.make_interp_spline(knots, np.eye(knots.size), k=5)
    return np.stack([spline(knots[:-1], nu=order) / math.factorial(order) for order in range(6)], axis=1)
