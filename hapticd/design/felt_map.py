"""Where fingers feel the frictions that are asked of them: over the places of one more finger."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hapticd.core.friction import FrictionCurve
from hapticd.values import FloatArray

from ..values import OnProgress
from .contact_pairs import ShapeMaps
from .felt_places import ENOUGH_JND, settle_felt, touches_at

_BLOCK = 200  # places solved at a time


@dataclass(frozen=True, slots=True)
class FeltMap:
    """Errors of all fingers (N + 1, ny, nx), in just noticeable differences, with another finger at each cell's centre,
    the last one; stickier than asked is positive."""

    x_mm: FloatArray
    y_mm: FloatArray
    errors_jnd: FloatArray

    @property
    def largest_jnd(self) -> FloatArray:
        """The error of the finger that is served worst, (ny, nx)."""
        return np.asarray(np.abs(self.errors_jnd).max(axis=0))

    @property
    def felt_frac(self) -> float:
        """The share of places where every finger feels what was asked, within one just noticeable difference."""
        return float(np.mean(self.largest_jnd <= ENOUGH_JND))


def felt_map(
    shapes: ShapeMaps,
    fingers_mm: Sequence[tuple[float, float]],
    frictions: Sequence[float],
    limits_um: Sequence[float],
    curve: FrictionCurve,
    *,
    radius_mm: float,
    size_mm: tuple[float, float],
    cells: int,
    progress: OnProgress = lambda _: None,
) -> FeltMap:
    """Return the map of cells x cells that tile the plate; `frictions` (N + 1,), 0 .. 1, are asked of the fingers, the
    other one last."""
    x_mm, y_mm = (edge_mm * ((np.arange(cells) + 0.5) / cells - 0.5) for edge_mm in size_mm)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    given_mm = np.broadcast_to(np.array(fingers_mm, np.float64), (len(points_mm), len(fingers_mm), 2))
    places_mm = np.concatenate((given_mm, points_mm[:, None, :]), axis=1)
    targets_um = [curve.amplitude_um(friction) for friction in frictions]
    blocks, solved = np.array_split(places_mm, math.ceil(len(places_mm) / _BLOCK)), []
    for done, block_mm in enumerate(blocks):
        progress(done / len(blocks))
        _, errors_jnd = settle_felt(touches_at(shapes, block_mm, radius_mm), targets_um, limits_um, curve=curve)
        solved.append(errors_jnd)
    return FeltMap(x_mm, y_mm, np.concatenate(solved).T.reshape(-1, cells, cells))
