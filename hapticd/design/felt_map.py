"""Where fingers feel the frictions that are asked of them: over the places of one more finger, or of random pairs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hapticd.core.friction import FrictionCurve
from hapticd.values import FloatArray

from ..values import OnProgress
from .contact_pairs import EDGE_MM, ShapeMaps, random_fingers
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


@dataclass(frozen=True, slots=True)
class FeltPairs:
    """Shares of random pairs in which both fingers feel what was asked, with the first (or the second) finger in each
    cell: `shares` (2, ny, nx), NaN in a cell without a pair. `felt_frac` is that of all `count` pairs."""

    x_mm: FloatArray
    y_mm: FloatArray
    shares: FloatArray
    felt_frac: float
    count: int


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
    """Return the map of cells x cells; `frictions` (N + 1,), 0 .. 1, are asked of the fingers, the other one last."""
    x_mm, y_mm, points_mm = _cell_centres(size_mm, cells)
    given_mm = np.broadcast_to(np.array(fingers_mm, np.float64), (len(points_mm), len(fingers_mm), 2))
    places_mm = np.concatenate((given_mm, points_mm[:, None, :]), axis=1)
    errors_jnd = _errors_jnd(shapes, places_mm, frictions, limits_um, curve, radius_mm, progress)
    return FeltMap(x_mm, y_mm, errors_jnd.T.reshape(-1, cells, cells))


def felt_pairs(
    shapes: ShapeMaps,
    frictions: Sequence[float],
    limits_um: Sequence[float],
    curve: FrictionCurve,
    *,
    radius_mm: float,
    size_mm: tuple[float, float],
    cells: int,
    count: int,
    progress: OnProgress = lambda _: None,
) -> FeltPairs:
    """Return the shares of `count` random pairs of two frictions. Raises ValueError for a plate without room."""
    places_mm = random_fingers(size_mm, count, seed=1)
    errors_jnd = _errors_jnd(shapes, places_mm, frictions, limits_um, curve, radius_mm, progress)
    is_felt = np.abs(errors_jnd).max(axis=1) <= ENOUGH_JND
    room_mm = size_mm[0] - 2.0 * EDGE_MM, size_mm[1] - 2.0 * EDGE_MM
    x_mm, y_mm, _ = _cell_centres(room_mm, cells)
    shares = [_shares(places_mm[:, finger], is_felt, room_mm, cells) for finger in range(2)]
    return FeltPairs(x_mm, y_mm, np.array(shares), float(is_felt.mean()), count)


def _cell_centres(size_mm: tuple[float, float], cells: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x_mm (cells,), y_mm (cells,) and all centres (cells^2, 2), by rows, of cells that tile the plate."""
    x_mm, y_mm = (edge_mm * ((np.arange(cells) + 0.5) / cells - 0.5) for edge_mm in size_mm)
    return x_mm, y_mm, np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)


def _shares(at_mm: FloatArray, is_felt: FloatArray, room_mm: tuple[float, float], cells: int) -> FloatArray:
    column, row = np.clip(((at_mm / room_mm + 0.5) * cells).astype(np.intp), 0, cells - 1).T
    cell = row * cells + column
    pairs = np.bincount(cell, minlength=cells * cells)
    felt = np.bincount(cell, weights=is_felt, minlength=cells * cells)
    with np.errstate(invalid="ignore"):
        return np.asarray((felt / pairs).reshape(cells, cells))


def _errors_jnd(
    shapes: ShapeMaps,
    places_mm: FloatArray,
    frictions: Sequence[float],
    limits_um: Sequence[float],
    curve: FrictionCurve,
    radius_mm: float,
    progress: OnProgress,
) -> FloatArray:
    """Return the error of each finger (P, N) at `places_mm` (P, N, 2)."""
    targets_um = [curve.amplitude_um(friction) for friction in frictions]
    blocks, solved = np.array_split(places_mm, math.ceil(len(places_mm) / _BLOCK)), []
    for done, block_mm in enumerate(blocks):
        progress(done / len(blocks))
        _, errors_jnd = settle_felt(touches_at(shapes, block_mm, radius_mm), targets_um, limits_um, curve=curve)
        solved.append(errors_jnd)
    return np.concatenate(solved)
