"""Mode shapes: from a measured mode map to the mode matrix Phi at the fingers (paper eq. 1-3).

A map is values on a rectangular grid; between its points the shapes are bicubic splines, which C evaluates
(`splines.c`). README.md compares interpolators.

Outside the map the shapes are those of the nearest edge point, which `inside` reports; a NaN position gives zeros.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.bicubic import BicubicSurfaces, fill_gaps
from hapticd.errors import ModesError
from hapticd.values import FloatArray

if TYPE_CHECKING:
    from hapticd.formats.mode_map import MapPath

__all__ = ["BicubicSurfaces", "ModeShapes", "ParasiticModes"]

_MIN_POINTS = 4  # what a cubic through a line of the grid needs
_MAX_POINTS = 400  # along one axis
_MAX_VALUES = 250_000  # of all modes, which take 0.15 kB each; two modes on 350 x 350 points
_MAX_MISSING_FRAC = 0.25  # beyond it a local fill would invent the map instead of mending it
_MIN_STEP_MM, _MAX_POSITION_MM, _MAX_VALUE = 1e-6, 1e6, 1e12  # beyond is a damaged file, and could overflow


class ModeShapes:
    """M mode shapes over the plate. Immutable; `x_mm` (nx,), `y_mm` (ny,) and `shapes` (M, ny, nx) are read-only.

    `tables` is what C evaluates (`BicubicSurfaces`).
    """

    def __init__(self, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike, shapes: npt.ArrayLike) -> None:
        """See `from_grid`."""
        self.x_mm, self.y_mm = _axis(x_mm, "x_mm"), _axis(y_mm, "y_mm")
        self.shapes = _whole_shapes(self.x_mm, self.y_mm, shapes)
        self._surfaces = BicubicSurfaces(self.x_mm, self.y_mm, self.shapes)
        self.tables = self._surfaces.tables
        self.M = int(self.shapes.shape[0])
        self._steepest_1_mm: float | None = None

    @classmethod
    def from_grid(cls, x_mm: npt.ArrayLike, y_mm: npt.ArrayLike, shapes: npt.ArrayLike) -> ModeShapes:
        """Interpolate `shapes` (M, ny, nx) over increasing axes `x_mm` (nx,), `y_mm` (ny,), at least 4 points each.

        The values are kept as they are; `design.fit_scan` smooths and scales. Up to a quarter of a mode's points
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

    def evaluate(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return the mode matrix (N, M) at `points_mm` (N, 2). Raises ValueError for another shape."""
        return self._surfaces.evaluate(_points(points_mm))

    def gradient(self, points_mm: npt.ArrayLike) -> FloatArray:
        """Return d(evaluate)/dx and /dy, (N, M, 2) in 1/mm, at `points_mm` (N, 2); outside, along the edge only."""
        return self._surfaces.gradient(_points(points_mm))

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
