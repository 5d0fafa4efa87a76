"""Support points of a plate: the common nodes of two modes, or the least motion of more; and a stamp's motion there.

A stamp is a disc around a node: the slope of the shapes moves it. Damping, and the shaking of a sensor under the plate,
grow with the largest motion within the disc.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..values import FloatArray
from .mode_shape import ModeShape

_CELLS_PER_WAVE = 12  # of the grid on which nodes are searched
_STEPS = 20  # of Newton's method, which needs five
_SETTLED = 1e-9
_SAME_MM = 0.1
_DISC_RADII, _DISC_ANGLES = 4, 16  # sample points of a disc
_TRIED = 200  # cells of least motion whose whole disc is judged
_INNER_FRAC = 0.25  # of the half plate: four stamps nearer to the middle let the plate tip


class Stamp(NamedTuple):
    """A support point, and the largest motion within the disc around it, as a share of the amplitude of all modes, in
    phase."""

    x_mm: float
    y_mm: float
    moved_frac: float


def common_nodes(shapes: Sequence[ModeShape], radius_mm: float) -> tuple[Stamp, ...]:
    """Return the common nodes of two `shapes` with room for a stamp of `radius_mm`, least motion first."""
    width_mm, depth_mm = shapes[0].size_mm
    lines = max(max(shape.nodal_lines) for shape in shapes) + 2
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, _CELLS_PER_WAVE * lines) for edge_mm in (width_mm, depth_mm))
    grids = np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes])
    corners = np.stack([grids[:, :-1, :-1], grids[:, 1:, :-1], grids[:, :-1, 1:], grids[:, 1:, 1:]])
    changes = (corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0)
    rows, columns = np.nonzero(changes.all(axis=0))
    start = np.stack(((x_mm[columns] + x_mm[columns + 1]) / 2, (y_mm[rows] + y_mm[rows + 1]) / 2), axis=-1)
    points = _nodes_near(shapes, start, reach_mm=2.0 * max(x_mm[1] - x_mm[0], y_mm[1] - y_mm[0]))
    room = (np.abs(points) <= np.array((width_mm, depth_mm)) / 2 - radius_mm).all(axis=1)
    points = _distinct(points[room])
    moved = _moved(shapes, points, radius_mm)
    order = np.lexsort(
        (*points.T, -np.round(np.abs(points[:, 0]), 3), np.round(moved, 6))
    )  # the same order on any machine
    return tuple(Stamp(float(points[i, 0]), float(points[i, 1]), float(moved[i])) for i in order)


def least_moved(shapes: Sequence[ModeShape], radius_mm: float) -> tuple[Stamp, ...]:
    """Return points with room for a stamp of `radius_mm` where all `shapes` move it least, least motion first.

    More than two modes have no common nodes; these points are on a grid, a twelfth of the shortest wave apart.
    """
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


def four_stamps(nodes: Sequence[Stamp], size_mm: tuple[float, float]) -> tuple[Stamp, ...]:
    """Return the node of least motion in each quadrant, away from the middle; fewer where a quadrant has none."""
    chosen = []
    for right, up in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        inner_x_mm, inner_y_mm = (_INNER_FRAC * edge_mm / 2 for edge_mm in size_mm)
        fitting = [node for node in nodes if right * node.x_mm >= inner_x_mm and up * node.y_mm >= inner_y_mm]
        chosen += fitting[:1]
    return tuple(chosen)


def _nodes_near(shapes: Sequence[ModeShape], start: FloatArray, reach_mm: float) -> FloatArray:
    """Run Newton's method from each start (N, 2); return the points that converge within reach."""
    points = start.copy()
    for _ in range(_STEPS):
        values = np.stack([shape.evaluate(points) for shape in shapes], axis=-1)
        slopes = np.stack([shape.gradient(points) for shape in shapes], axis=-2)
        points = points - np.einsum("nij,nj->ni", np.linalg.pinv(slopes), values)
    left = np.abs(np.stack([shape.evaluate(points) for shape in shapes])).max(axis=0)
    is_near = np.hypot(*(points - start).T) <= reach_mm
    return np.asarray(points[(left <= _SETTLED) & is_near], np.float64)


def _distinct(points: FloatArray) -> FloatArray:
    kept: list[FloatArray] = []
    for point in points:
        if all(np.hypot(*(point - other)) > _SAME_MM for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _moved(shapes: Sequence[ModeShape], points: FloatArray, radius_mm: float) -> FloatArray:
    """Return the largest sum of |shape| within each disc (N,)."""
    radii = radius_mm * np.arange(1, _DISC_RADII + 1) / _DISC_RADII
    angles = 2.0 * np.pi * np.arange(_DISC_ANGLES) / _DISC_ANGLES
    disc = (radii[:, None, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)).reshape(-1, 2)
    around = (points[:, None] + disc).reshape(-1, 2)
    size = sum(np.abs(shape.evaluate(around)) for shape in shapes)
    return np.asarray(np.reshape(size, (len(points), len(disc))).max(axis=1), np.float64)
