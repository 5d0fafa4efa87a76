"""Achievability: the amplitude that slipping fingers reach, for positions of one more finger.

Fingers share the plate's modes, and some pairs of positions cannot both reach their targets. For positions of another
finger, still or slipping, it is the amplitude of the slipping fingers while still ones are held at
exactly zero, by the rules of `core.solver` (`keep_zero`). Left out: derating, parasitic modes and prediction. Fingers
are points, and of several slipping fingers only the signs are free, not the phases.

The reach of one slipping finger is a linear program: maximise p.W with |W_k| <= L_k and A W = 0, where A holds the
still fingers' shapes. Its dual is a least absolute deviation: minimise sum_k L_k |p_k - (A'v)_k| over v. At an optimum
rank(A) of these terms vanish, so trying each such set of modes finds it; with one still finger that is a weighted
median (Bloomfield and Steiger, Least Absolute Deviations, 1983).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.public import solve_batch
from hapticd.values import FloatArray

_RANK_FRAC = 1e-12  # of the largest singular value: below it a still finger repeats the others


class MapFinger(NamedTuple):
    """Position and target amplitude of a finger that does not move over the plate; 0 um is still."""

    x_mm: float
    y_mm: float
    target_um: float


def achievable_share(
    modes: ModeShapes,
    fingers: Sequence[MapFinger],
    other_um: float,
    limit_um: Sequence[float],
    points_mm: npt.ArrayLike,
) -> FloatArray:
    """Return achieved over target of the worst served slipping finger, at most 1, with the other finger at `points_mm`
    (K, 2): (K,), NaN without a slipping finger. In closed form with one slipping finger, by the solver with several."""
    phi, target_um = _mode_matrices(modes, fingers, np.asarray(points_mm, np.float64)), _targets(fingers, other_um)
    if np.count_nonzero(target_um) == 1:
        slips = target_um > 0.0
        reached_um = reach_um(phi[:, slips][:, 0], phi[:, ~slips], limit_um)
        return np.asarray(np.minimum(reached_um / target_um.max(), 1.0))
    achieved_um = np.abs(np.einsum("knm,km->kn", phi, solve_batch(phi, target_um, limit_um)))
    return _share(achieved_um, target_um)


def reach_um(slipping: FloatArray, still: FloatArray, limit_um: npt.ArrayLike) -> FloatArray:
    """Return the largest |slipping . W| with |W_k| <= limit_k and still W = 0: (K,) in um.

    slipping (K, M) and still (K, S, M) are the shapes at the slipping finger and at the S still ones.
    """
    limits = np.broadcast_to(np.asarray(limit_um, np.float64), slipping.shape[1:])
    reach = np.full(len(slipping), np.inf)
    for cells, basis in row_spaces(still):
        reach[cells] = least_deviation(slipping[cells], basis, limits)
    return reach


def row_spaces(still: FloatArray) -> Iterator[tuple[npt.NDArray[np.intp], FloatArray]]:
    """Yield for each rank the cells that have it, and orthonormal rows (cells, rank, M) spanning their still shapes."""
    if still.shape[1] == 0:
        yield np.arange(len(still)), still
        return
    _, sizes, rows = np.linalg.svd(still, full_matrices=False)
    ranks = np.count_nonzero(sizes > _RANK_FRAC * sizes[:, :1], axis=1)
    for rank in np.unique(ranks):
        cells = np.flatnonzero(ranks == rank)
        yield cells, rows[cells, :rank]


def least_deviation(slipping: FloatArray, basis: FloatArray, limits: FloatArray) -> FloatArray:
    """Return the minimum over v of sum_k L_k |p_k - (B'v)_k|, (K,); p = slipping (K, M), B = basis (K, rank, M)."""
    rank, modes = basis.shape[1:]
    least = np.full(len(slipping), np.inf)
    for chosen in map(list, combinations(range(modes), rank)):
        square = basis[:, :, chosen].transpose(0, 2, 1)
        singular = np.linalg.det(square) == 0.0
        square = np.where(singular[:, None, None], np.eye(rank), square)
        v = np.linalg.solve(square, slipping[:, chosen, None])[..., 0]
        deviation = np.abs(slipping - np.einsum("krm,kr->km", basis, v))
        deviation[:, chosen] = 0.0  # exactly; near-singular sets would leave large rounding errors
        least = np.where(singular, least, np.minimum(least, deviation @ limits))
    return least


def _mode_matrices(modes: ModeShapes, fingers: Sequence[MapFinger], points_mm: FloatArray) -> FloatArray:
    """Return Phi (K, N + 1, M), its last row the other finger at each of the points."""
    here = modes.evaluate(np.array([finger[:2] for finger in fingers], np.float64).reshape(-1, 2))
    there = modes.evaluate(points_mm)[:, None, :]
    return np.concatenate((np.broadcast_to(here, (len(points_mm), *here.shape)), there), axis=1)


def _targets(fingers: Sequence[MapFinger], other_um: float) -> FloatArray:
    return np.array([*(finger.target_um for finger in fingers), other_um], np.float64)


def _share(achieved_um: FloatArray, target_um: FloatArray) -> FloatArray:
    slips = target_um > 0.0
    if not slips.any():
        return np.full(len(achieved_um), np.nan)
    return np.asarray(np.minimum(achieved_um[:, slips] / target_um[slips], 1.0).min(axis=1))
