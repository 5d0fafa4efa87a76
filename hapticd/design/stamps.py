"""Support points of a plate: where all modes move a stamp least.

A stamp is a disc: the slope of the shapes moves it. Damping, and the shaking of a sensor under the plate,
grow with the largest motion within the disc.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..values import FloatArray
from .mode_shape import ModeShape

_CELLS_PER_WAVE = 12  # of the grid on which points are searched
_DISC_RADII, _DISC_ANGLES = 4, 16  # sample points of a disc
_TRIED = 200  # cells of least motion whose whole disc is judged
_INNER_FRAC = 0.25  # of the half plate: four stamps nearer to the middle let the plate tip


class Stamp(NamedTuple):
    """A support point, and the largest motion within the disc around it, as a share of the amplitude of all modes, in
    phase."""

    x_mm: float
    y_mm: float
    moved_frac: float


def least_moved(shapes: Sequence[ModeShape], radius_mm: float) -> tuple[Stamp, ...]:
    """Return points with room for a stamp of `radius_mm` where all `shapes` move it least, least motion first:
    on a grid, a twelfth of the shortest wave apart."""
    lines = max(max(shape.nodal_lines) for shape in shapes) + 2
    x_mm, y_mm = (
        np.linspace(-1.0, 1.0, _CELLS_PER_WAVE * lines) * (edge_mm / 2 - radius_mm) for edge_mm in shapes[0].size_mm
    )
    size = np.sum([np.abs(shape.on_grid(x_mm, y_mm)) for shape in shapes], axis=0)
    points: list[FloatArray] = []
    inner_x_mm, inner_y_mm = (_INNER_FRAC * edge_mm / 2 for edge_mm in shapes[0].size_mm)
    for right in (x_mm <= -inner_x_mm, x_mm >= inner_x_mm):
        for up in (y_mm <= -inner_y_mm, y_mm >= inner_y_mm):  # some in each quadrant, for `four_stamps`
            quarter = np.where(np.outer(up, right), size, np.inf)
            cells = np.argsort(quarter, axis=None, kind="stable")[: _TRIED // 4]
            rows, columns = np.unravel_index(cells, size.shape)
            points += list(np.stack((x_mm[columns], y_mm[rows]), axis=-1))
    moved = _moved(shapes, np.array(points), radius_mm)
    order = np.argsort(np.round(moved, 9), kind="stable")
    return tuple(Stamp(float(points[i][0]), float(points[i][1]), float(moved[i])) for i in order)


def four_stamps(points: Sequence[Stamp], size_mm: tuple[float, float]) -> tuple[Stamp, ...]:
    """Return the point of least motion in each quadrant, away from the middle; fewer where a quadrant has none."""
    chosen = []
    for right, up in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        inner_x_mm, inner_y_mm = (_INNER_FRAC * edge_mm / 2 for edge_mm in size_mm)
        fitting = [one for one in points if right * one.x_mm >= inner_x_mm and up * one.y_mm >= inner_y_mm]
        chosen += fitting[:1]
    return tuple(chosen)


def _moved(shapes: Sequence[ModeShape], points: FloatArray, radius_mm: float) -> FloatArray:
    """Return the largest sum of |shape| within each disc (N,)."""
    radii = radius_mm * np.arange(1, _DISC_RADII + 1) / _DISC_RADII
    angles = 2.0 * np.pi * np.arange(_DISC_ANGLES) / _DISC_ANGLES
    disc = (radii[:, None, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)).reshape(-1, 2)
    around = (points[:, None] + disc).reshape(-1, 2)
    size = sum(np.abs(shape.evaluate(around)) for shape in shapes)
    return np.asarray(np.reshape(size, (len(points), len(disc))).max(axis=1), np.float64)
