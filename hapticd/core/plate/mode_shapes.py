"""Mode shapes: from a measured mode map to the mode matrix Phi at the fingers (paper eq. 1-3).

A map is values on a rectangular grid; between its points the shapes are bicubic splines. `at` and `at_with_gradient`
evaluate one point in plain Python floats, for the tick; `evaluate` and `gradient` take arrays of points. Both do the
same operations in the same order and agree to the last bit. README.md compares interpolators.

Outside the map the shapes are those of the nearest edge point, which `inside` reports; a NaN position gives zeros.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.bicubic import BicubicPatch, BicubicSurfaces, fill_gaps
from hapticd.errors import ModesError
from hapticd.values import FloatArray

if TYPE_CHECKING:
    from hapticd.formats.mode_map import MapPath

__all__ = ["BicubicSurfaces", "ModeShapes", "ParasiticModes"]

_Row = tuple[float, ...]  # of M shapes at one point
_Slope = tuple[float, float, float]  # a shape's value, and its derivatives along x and y in 1/mm

_MIN_POINTS = 4  # what a cubic through a line of the grid needs
_MAX_POINTS = 400  # along one axis
_MAX_VALUES = 250_000  # of all modes, which take 0.15 kB each; two modes on 350 x 350 points
_MAX_MISSING_FRAC = 0.25  # beyond it a local fill would invent the map instead of mending it
_MIN_STEP_MM, _MAX_POSITION_MM, _MAX_VALUE = 1e-6, 1e6, 1e12  # beyond is a damaged file, and could overflow
_FEW_POINTS = 32  # up to here the scalar path beats numpy's fixed cost


class ModeShapes:
    """M mode shapes over the plate. Immutable; `x_mm` (nx,), `y_mm` (ny,) and `shapes` (M, ny, nx) are read-only.

    `tables` is what C takes `at` from: views of `BicubicSurfaces.patches`, and of the knots x_mm and y_mm.
    """

    def __init__(self, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike, shapes: npt.ArrayLike) -> None:
        """See `from_grid`."""
        self.x_mm, self.y_mm = _axis(x_mm, "x_mm"), _axis(y_mm, "y_mm")
        self.shapes = _whole_shapes(self.x_mm, self.y_mm, shapes)
        self._surfaces = BicubicSurfaces(self.x_mm, self.y_mm, self.shapes)
        self.tables = self._surfaces.patches.data, self.x_mm.data, self.y_mm.data
        self.M = int(self.shapes.shape[0])
        self._cells: list[tuple[BicubicPatch, ...] | None] = [None] * len(self._surfaces.patches)
        self._columns = int(self.x_mm.size) - 1
        self._columns_per_mm = self._columns / float(self.x_mm[-1] - self.x_mm[0])
        self._rows_per_mm = (int(self.y_mm.size) - 1) / float(self.y_mm[-1] - self.y_mm[0])
        self._x_knots: tuple[float, ...] = tuple(self.x_mm.tolist())
        self._y_knots: tuple[float, ...] = tuple(self.y_mm.tolist())
        self._zeros = (0.0,) * self.M
        self._steepest_1_mm: float | None = None

    @classmethod
    def from_grid(cls, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike, shapes: npt.ArrayLike) -> ModeShapes:
        """Interpolate `shapes` (M, ny, nx) over increasing axes `x_mm` (nx,), `y_mm` (ny,), at least 4 points each.

        The values are kept as they are; `design.fit_cartography` smooths and scales. Up to a quarter of a mode's points
        may be NaN; they are interpolated (`fill_gaps`). Raises ModesError for an invalid map.
        """
        return cls(x_mm, y_mm, shapes)

    @classmethod
    def load(cls, path: MapPath) -> ModeShapes:
        """Read a map from an NPZ or CSV file (`formats.mode_map`); raises ModesError."""
        from hapticd.formats.mode_map import read_grid

        try:
            return cls(*read_grid(path))
        except ModesError as error:
            if str(path) in str(error):
                raise
            raise ModesError(f"{path}: {error}") from error

    def save(self, path: MapPath) -> None:
        """Write the map as NPZ or CSV, by the file's suffix; `load` gives back the same numbers."""
        from hapticd.formats.mode_map import write_grid

        write_grid(path, (self.x_mm, self.y_mm, self.shapes))

    def at(self, x_mm: float, y_mm: float) -> _Row:
        """Return all M shapes at one point as floats; clamped outside, zeros for NaN."""
        cell, u, v = self._located(x_mm, y_mm)
        return self._zeros if cell < 0 else tuple([patch.value(u, v) for patch in self._patches(cell)])

    def at_with_gradient(self, x_mm: float, y_mm: float) -> tuple[_Slope, ...]:
        """Return (phi, dphi/dx, dphi/dy) of all M shapes at one point, in 1 and 1/mm: `at` and `gradient` in one."""
        if not self._is_on_map(x_mm, y_mm):
            return self._beyond_with_gradient(x_mm, y_mm)
        cell, u, v = self._located(x_mm, y_mm)
        return tuple([patch.slope(u, v) for patch in self._patches(cell)])

    def _is_on_map(self, x_mm: float, y_mm: float) -> bool:
        """False for NaN."""
        x_knots, y_knots = self._x_knots, self._y_knots
        return x_knots[0] <= x_mm <= x_knots[-1] and y_knots[0] <= y_mm <= y_knots[-1]

    def _located(self, x_mm: float, y_mm: float) -> tuple[int, float, float]:
        """Cell of the nearest point on the map, and distances to its lower left corner; cell -1 for NaN."""
        x_knots, y_knots = self._x_knots, self._y_knots
        if not self._is_on_map(x_mm, y_mm):
            if x_mm != x_mm or y_mm != y_mm:
                return -1, 0.0, 0.0
            x_mm = min(max(x_mm, x_knots[0]), x_knots[-1])
            y_mm = min(max(y_mm, y_knots[0]), y_knots[-1])
        column = _interval(x_knots, self._columns_per_mm, x_mm)
        row = _interval(y_knots, self._rows_per_mm, y_mm)
        return row * self._columns + column, x_mm - x_knots[column], y_mm - y_knots[row]

    def _patches(self, cell: int) -> tuple[BicubicPatch, ...]:
        """The cell's surfaces, built on first use."""
        patches = self._cells[cell]
        if patches is None:
            patches = self._cells[cell] = tuple([BicubicPatch(row) for row in self._surfaces.patches[cell].tolist()])
        return patches

    def _beyond_with_gradient(self, x_mm: float, y_mm: float) -> tuple[_Slope, ...]:
        """Outside the map: the shapes of the edge, with zero slope across it."""
        if x_mm != x_mm or y_mm != y_mm:
            return ((0.0, 0.0, 0.0),) * self.M
        edge_x_mm = min(max(x_mm, self._x_knots[0]), self._x_knots[-1])
        edge_y_mm = min(max(y_mm, self._y_knots[0]), self._y_knots[-1])
        is_on_x, is_on_y = edge_x_mm == x_mm, edge_y_mm == y_mm
        slopes = self.at_with_gradient(edge_x_mm, edge_y_mm)
        return tuple([(phi, dx if is_on_x else 0.0, dy if is_on_y else 0.0) for phi, dx, dy in slopes])

    def evaluate(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return the mode matrix (N, M) at `points_mm` (N, 2). Raises ValueError for another shape."""
        points = _points(points_mm)
        if len(points) <= _FEW_POINTS:
            return np.array([self.at(x_mm, y_mm) for x_mm, y_mm in points.tolist()], float).reshape(-1, self.M)
        return self._surfaces.evaluate(points)

    def gradient(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return d(evaluate)/dx and /dy, (N, M, 2) in 1/mm, at `points_mm` (N, 2); outside, along the edge only."""
        points = _points(points_mm)
        if len(points) <= _FEW_POINTS:
            rows = [self.at_with_gradient(x_mm, y_mm) for x_mm, y_mm in points.tolist()]
            return np.array(rows, float).reshape(-1, self.M, 3)[..., 1:]
        return self._surfaces.gradient(points)

    def steepest_1_mm(self) -> float:
        """Return the greatest slope of any mode, in 1/mm, at the map's points and halfway between them.

        Computed once, because it takes 50 ms.
        """
        if self._steepest_1_mm is None:
            self._steepest_1_mm = self._measured_steepest_1_mm()
        return self._steepest_1_mm

    def _measured_steepest_1_mm(self) -> float:
        x, y = (np.sort(np.concatenate((knots, (knots[1:] + knots[:-1]) / 2.0))) for knots in (self.x_mm, self.y_mm))
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return float(np.hypot(*np.moveaxis(self._surfaces.gradient(points), -1, 0)).max())

    def inside(self, points_mm: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return whether each of `points_mm` (N, 2) lies on the map or its edge; shapes outside are clamped."""
        x, y = _points(points_mm).T
        on_x = (x >= self.x_mm[0]) & (x <= self.x_mm[-1])
        return np.asarray(on_x & (y >= self.y_mm[0]) & (y <= self.y_mm[-1]), np.bool_)


class ParasiticModes:
    """Measured modes that are near the drive but not driven: shapes, decay (1/s) and detuning from the drive (rad/s) of
    each. Touches make them move, which `hapticd calibrate touch` takes into account. Raises ValueError for numbers that
    are not one for each mode, or not finite.
    """

    def __init__(self, modes: ModeShapes, decay_1_s: Sequence[float], detuning_rad_s: Sequence[float]) -> None:
        if not len(decay_1_s) == len(detuning_rad_s) == modes.M:
            raise ValueError(f"{modes.M} neighbouring modes need as many decays and detunings.")
        if not all(decay > 0.0 for decay in decay_1_s):
            raise ValueError("The neighbouring modes' decays must be above 0.")
        if not all(map(math.isfinite, (*decay_1_s, *detuning_rad_s))):
            raise ValueError("The neighbouring modes' decays and detunings must be finite.")
        self.modes = modes
        self.decay_1_s = tuple(decay_1_s)
        self.detuning_rad_s = tuple(detuning_rad_s)


def _interval(knots: tuple[float, ...], per_mm: float, position_mm: float) -> int:
    """Index of the knot interval of a position within the knots: computed on an even grid, else by bisection."""
    last = len(knots) - 1
    guess = min(int((position_mm - knots[0]) * per_mm), last - 1)
    if knots[guess] <= position_mm < knots[guess + 1]:
        return guess
    return bisect_right(knots, position_mm, 1, last) - 1


def _points(points_mm: npt.ArrayLike) -> FloatArray:
    points = np.asarray(points_mm, np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points_mm has shape {points.shape}; give (N, 2), a row per point.")
    return points


def _axis(values_mm: npt.ArrayLike, name: str) -> FloatArray:
    axis = np.array(values_mm, np.float64)
    if axis.ndim != 1 or not _MIN_POINTS <= axis.size <= _MAX_POINTS:
        raise ModesError(
            f"{name} has shape {axis.shape}; give at least {_MIN_POINTS} and at most {_MAX_POINTS} positions."
        )
    if not (np.isfinite(axis).all() and (np.diff(axis) > 0.0).all()):
        raise ModesError(f"{name} does not increase from each position to the next; sort it and remove doubles.")
    if not (np.abs(axis).max() <= _MAX_POSITION_MM and np.diff(axis).min() >= _MIN_STEP_MM):
        raise ModesError(f"{name} holds positions that no plate has; check that they are in mm.")
    axis.setflags(write=False)
    return axis


def _whole_shapes(x_mm: FloatArray, y_mm: FloatArray, values: npt.ArrayLike) -> FloatArray:
    shapes = np.array(values, np.float64)
    if shapes.ndim != 3 or shapes.shape[0] < 1 or shapes.shape[1:] != (y_mm.size, x_mm.size):
        raise ModesError(
            f"the shapes are {shapes.shape} where the axes ask for (modes, {y_mm.size}, {x_mm.size}); "
            "order them as mode, y, x."
        )
    if shapes.size > _MAX_VALUES:
        raise ModesError(f"the shapes have {shapes.size} values, more than {_MAX_VALUES}; measure on a coarser grid.")
    if (np.abs(shapes) > _MAX_VALUE).any():
        raise ModesError(
            f"a shape is infinite or absurdly large (above {_MAX_VALUE:g}); measure that point again or leave it empty."
        )
    missing_frac = np.isnan(shapes).mean(axis=(1, 2))
    worst = int(np.argmax(missing_frac))
    if missing_frac[worst] > _MAX_MISSING_FRAC:
        raise ModesError(
            f"mode {worst + 1} has no value at {100.0 * missing_frac[worst]:.0f} % of its points, more than can be "
            f"filled in; measure them again or fit the map first."
        )
    shapes = fill_gaps(x_mm, y_mm, shapes)
    shapes.setflags(write=False)
    return shapes
