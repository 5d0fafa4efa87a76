"""Which places are good for a finger at all: for each, on what part of the plate another one has its wish too.

All pairs of places, one finger slipping and one still, as in `achievability.reach_um`: what a plate and its modes are
worth before anybody touches it. Random pairs would do for the mean, but not tell which places spoil it.
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
    """Parts of the plate, at the cells' centres: arrays (ny, nx) of 0 .. 1.

    `slipping`: of the plate, for a finger that slips here, where another can be still; `still`: for one that is still
    here, where another can slip. Both have the same mean, for they are of the same pairs.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    slipping: FloatArray
    still: FloatArray


def pair_map(
    modes: ModeShapes, wanted_um: float, limit_um: Sequence[float], *, size_mm: tuple[float, float], cells: int
) -> PairMap:
    """Where a slipping finger gets at least `wanted_um`; limit_um (M,). The work is the fourth power of `cells`."""
    x_mm, y_mm, points_mm = cell_centres(size_mm, cells)
    phi, limits = modes.evaluate(points_mm), np.asarray(limit_um, np.float64)
    slipping, still = np.zeros(len(phi)), np.zeros(len(phi))
    for places, basis in row_spaces(phi[:, None, :]):
        for here, shapes in enumerate(phi):
            reach_um = least_deviation(np.broadcast_to(shapes, (len(places), modes.M)), basis, limits)
            served = reach_um >= wanted_um * FULL_FRAC
            slipping[here] += np.count_nonzero(served)
            still[places] += served
    grid = (cells, cells)
    return PairMap(x_mm, y_mm, (slipping / len(phi)).reshape(grid), (still / len(phi)).reshape(grid))
