"""The reference plate's driven modes, and grids of points, for the tests of fits."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from hapticd.design import CartographyFit, ModeShape, fit_scan, free_plate_modes


@cache
def driven_modes() -> list[ModeShape]:
    by_name = {shape.name: shape for _, shape in free_plate_modes()}
    return [by_name["11x0"], by_name["0x11"]]


def grid_points(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Return the points (N, 2) of a grid, row by row."""
    return np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)


def fit_grid(x_mm: np.ndarray, y_mm: np.ndarray, shapes: np.ndarray, **options: Any) -> CartographyFit:
    """Fit shapes (M, ny, nx) on a grid, in the scale of the readings."""
    return fit_scan(grid_points(x_mm, y_mm), shapes.reshape(len(shapes), -1).T, normalise=False, **options)
