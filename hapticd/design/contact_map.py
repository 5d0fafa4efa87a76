"""Contrast between whole contacts over the plate: still fingers at given positions, one slipping anywhere else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.friction import FrictionCurve
from ..values import FloatArray, OnProgress
from .achievability import cell_centres
from .contact_pairs import ShapeMaps, contact_rms_um, grams, settle

_BLOCK = 2000  # positions solved at a time


@dataclass(frozen=True, slots=True)
class ContactMap:
    """RMS amplitudes over contacts (ny, nx), for a slipping finger at each cell's centre.

    `still_um` is that of the still finger which is shaken most.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    slip_um: FloatArray
    still_um: FloatArray

    @property
    def contrast(self) -> FloatArray:
        """The slipping contact's amplitude over the still one's, (ny, nx)."""
        return self.slip_um / self.still_um


def contact_map(
    shapes: ShapeMaps,
    still_mm: Sequence[tuple[float, float]],
    target_um: float,
    limits_um: Sequence[float],
    curve: FrictionCurve,
    *,
    radius_mm: float,
    size_mm: tuple[float, float],
    cells: int,
    progress: OnProgress = lambda _: None,
) -> ContactMap:
    """Return the map of cells x cells; still_mm has one position or more. `progress` is called with the share done."""
    x_mm, y_mm, points_mm = cell_centres(size_mm, cells)
    held = grams(shapes, np.array(still_mm, np.float64), radius_mm)  # (M, M, S)
    blocks, solved = np.array_split(points_mm, math.ceil(len(points_mm) / _BLOCK)), []
    for done, places_mm in enumerate(blocks):
        progress(done / len(blocks))
        slipping = grams(shapes, places_mm, radius_mm)
        each_still = [np.repeat(one[:, :, None], len(places_mm), axis=2) for one in np.moveaxis(held, 2, 0)]
        w_um = settle(slipping, each_still, target_um, limits_um, curve)
        still_um = np.max([contact_rms_um(still, w_um) for still in each_still], axis=0)
        solved.append(np.stack((contact_rms_um(slipping, w_um), still_um)))
    slip_um, still_um = np.concatenate(solved, axis=1).reshape(2, cells, cells)
    return ContactMap(x_mm, y_mm, slip_um, still_um)
