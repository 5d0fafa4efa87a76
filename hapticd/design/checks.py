"""Validation of a scan before the fit; each error says what to do."""

from __future__ import annotations

import math

import numpy as np

from hapticd.errors import ModesError
from hapticd.values import FloatArray

from .readings import Readings

MIN_LINES = 8  # per axis: fewer cannot hold a wave and its surroundings

_MOST_SHIFT_MM = 5.0  # a shifted scan may reach this far beyond the plate
_LEAST_COVER_FRAC = 0.5  # of an edge: a smaller scan has other units, or another plate's size
_MAX_VALUE = 1e12  # larger is a damaged file, and squares could overflow
_MIN_VALUE = 1e-60  # smaller counts as zero: its square could vanish


def require_grid(x_mm: FloatArray, y_mm: FloatArray, shapes: Readings) -> None:
    """Check increasing axes and `shapes` (M, ny, nx) on them; raises ModesError."""
    for axis, name in ((x_mm, "x_mm"), (y_mm, "y_mm")):
        if axis.ndim != 1 or axis.size < MIN_LINES or not (np.diff(axis) > 0.0).all():
            raise ModesError(f"{name} needs at least {MIN_LINES} increasing positions; sort or extend it.")
    if shapes.ndim != 3 or len(shapes) < 1 or shapes.shape[1:] != (y_mm.size, x_mm.size):
        expected = f"(modes, {y_mm.size}, {x_mm.size})"
        raise ModesError(f"the shapes are {shapes.shape}, the axes need {expected}; order them as mode, y, x.")


def require_scan(
    points_mm: FloatArray, readings: Readings, lines: tuple[int, int], size_mm: tuple[float, float]
) -> None:
    """Check points (N, 2) on the plate and readings (N, M); raises ModesError."""
    if min(lines) < MIN_LINES or readings.shape[1] < 1:
        raise ModesError(f"{len(points_mm)} points are too few; measure at least {MIN_LINES} lines by {MIN_LINES}.")
    if not np.isfinite(points_mm).all():
        raise ModesError("a point's position is not a number; give it or remove the point.")
    for position_mm, name, edge_mm in zip(points_mm.T, ("x_mm", "y_mm"), size_mm, strict=True):
        low, high = float(position_mm.min()), float(position_mm.max())
        if high - low < _LEAST_COVER_FRAC * edge_mm:
            raise ModesError(
                f"{name} runs from {low:g} to {high:g}, less than half of a plate of {edge_mm:g} mm; "
                "give positions in mm, or the plate's size."
            )
        if not (-edge_mm / 2.0 - _MOST_SHIFT_MM <= low and high <= edge_mm / 2.0 + _MOST_SHIFT_MM):
            raise ModesError(
                f"{name} runs from {low:g} to {high:g} mm, off a plate of {edge_mm:g} mm; "
                "give the plate's size, or measure positions from its centre."
            )
    if (np.abs(readings) > _MAX_VALUE).any():
        raise ModesError("a shape is infinite or absurdly large somewhere; measure that point again or leave it empty.")
    if np.isfinite(readings).all(axis=1).mean() < 0.5:
        raise ModesError("more than half of the points have no value in some mode; measure them again.")
    for mode, shape in enumerate(readings.T, 1):
        if not np.nanmax(np.abs(shape)) > _MIN_VALUE:
            raise ModesError(f"mode {mode} is zero everywhere; remove it or measure it again.")


def require_size(size_mm: tuple[float, float]) -> None:
    """Check a plate's width and depth; raises ValueError."""
    if not all(0.0 < edge_mm < math.inf for edge_mm in size_mm):
        raise ValueError(f"size_mm is {size_mm}; give the plate's width and depth in mm.")
