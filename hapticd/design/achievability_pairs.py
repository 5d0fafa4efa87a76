"""Achievability over all pairs of positions, one finger slipping and one still: the worth of a plate and its modes.

Random pairs would give the mean as well, but not the positions that lower it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes

from .achievability import FULL_FRAC, cell_centres, least_deviation, row_spaces
from .legendre import FloatArray


@dataclass(frozen=True, slots=True)
class PairMap:
    """Fractions of the plate, 0 .. 1, at the cells' centres (ny, nx).

    `slipping`: where another finger can be still while one slips here. `still`: where another can slip while one is
    still here. Both have the same mean: they count the same pairs.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    slipping: FloatArray
    still: FloatArray


def pair_map(
    modes: ModeShapes, target_um: float, limit_um: Sequence[float], *, size_mm: tuple[float, float], cells: int
) -> PairMap:
    """Count the pairs where the slipping finger reaches `target_um`; limit_um (M,). Takes time of order cells^4."""
    x_mm, y_mm, points_mm = cell_centres(size_mm, cells)
    phi, limits = modes.evaluate(points_mm), np.asarray(limit_um, np.float64)
    slipping, still = np.zeros(len(phi)), np.zeros(len(phi))
    for places, basis in row_spaces(phi[:, None, :]):
        for here, shapes in enumerate(phi):
            reach_um = least_deviation(np.broadcast_to(shapes, (len(places), modes.M)), basis, limits)
            served = reach_um >= target_um * FULL_FRAC
            slipping[here] += np.count_nonzero(served)
            still[places] += served
    grid = (cells, cells)
    return PairMap(x_mm, y_mm, (slipping / len(phi)).reshape(grid), (still / len(phi)).reshape(grid))
