"""Interpolators of a mode map: the chosen bicubic, two alternatives, and scipy's.

Each gives M shapes at points, or shapes and gradients in one pass. Ours are written like `ModeShapes.at`, in plain
floats with coefficients by cell. Quintic splines are built by scipy and only evaluated here.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..core.plate.mode_shapes import ModeShapes

FloatArray = npt.NDArray[np.float64]
Points = Sequence[tuple[float, float]]
Evaluate = Callable[[Points], Any]  # points -> (N, M), as nested sequences or an array
Slope = tuple[float, float, float]  # value, slope along x, slope along y


class Interpolator(NamedTuple):
    """`shapes` (N, M), and `with_gradient` (N, M, 3): value, slope along x, slope along y."""

    shapes: Evaluate
    with_gradient: Evaluate


def interpolators(modes: ModeShapes, interpolate: Any | None) -> dict[str, Interpolator]:
    """Return the interpolators by name; those of scipy only where its module `interpolate` is given."""
    linear = _Bilinear(modes)
    found = {
        "bicubic": _each(modes.at, modes.at_with_gradient),
        "bilinear": _each(linear.at, linear.at_with_gradient),
    }
    if interpolate is not None:
        quintic = _Quintic(modes, interpolate)
        found["quintic"] = _each(quintic.at, quintic.at_with_gradient)
        found["RectBivariateSpline"] = _fitpack(modes, interpolate)
    return found


def _each(at: Callable[[float, float], Any], with_gradient: Callable[[float, float], Any]) -> Interpolator:
    return Interpolator(
        lambda points: [at(x, y) for x, y in points], lambda points: [with_gradient(x, y) for x, y in points]
    )


def _fitpack(modes: ModeShapes, interpolate: Any) -> Interpolator:
    splines = [interpolate.RectBivariateSpline(modes.y_mm, modes.x_mm, shape) for shape in modes.shapes]

    def with_gradient(points: Points) -> FloatArray:
        x, y = np.asarray(points).T
        values = [[spline.ev(y, x), spline.ev(y, x, dy=1), spline.ev(y, x, dx=1)] for spline in splines]
        return np.transpose(values, (2, 0, 1))

    def shapes(points: Points) -> FloatArray:
        x, y = np.asarray(points).T
        return np.transpose([spline.ev(y, x) for spline in splines])

    return Interpolator(shapes, with_gradient)


class _Grid:
    """Location of a point: its cell, and the distances to the cell's lower left corner."""

    def __init__(self, modes: ModeShapes) -> None:
        self._x, self._y = modes.x_mm.tolist(), modes.y_mm.tolist()

    def _cell(self, x_mm: float, y_mm: float) -> tuple[int, float, float]:
        x, y = self._x, self._y
        column = bisect_right(x, x_mm, 1, len(x) - 1) - 1
        row = bisect_right(y, y_mm, 1, len(y) - 1) - 1
        return row * (len(x) - 1) + column, x_mm - x[column], y_mm - y[row]


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

    def at_with_gradient(self, x_mm: float, y_mm: float) -> list[Slope]:
        cell, u, v = self._cell(x_mm, y_mm)
        return [((d * v + b) * u + c * v + a, d * v + b, d * u + c) for a, b, c, d in self._cells[cell]]


class _Quintic(_Grid):
    """A polynomial of degree 5 by 5 in each cell: 36 coefficients for each shape."""

    def __init__(self, modes: ModeShapes, interpolate: Any) -> None:
        super().__init__(modes)
        along_x, along_y = (_taylor(knots, interpolate) for knots in (modes.x_mm, modes.y_mm))
        table = np.einsum("jdn,icl,mnl->jimdc", along_y, along_x, modes.shapes, optimize=True)
        table = table.reshape(-1, modes.M, 6, 6)[:, :, ::-1, ::-1]  # highest powers first, for Horner's scheme
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

    def at_with_gradient(self, x_mm: float, y_mm: float) -> list[Slope]:
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
