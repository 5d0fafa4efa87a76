"""Achievability map: the amplitude that slipping fingers reach, for every position of one more finger.

Fingers share the plate's modes, and some pairs of positions cannot both reach their targets. For every position of
another finger, still or slipping, the map gives the amplitude of the slipping fingers while still ones are held at
exactly zero, by the rules of `core.solver` (`keep_zero`). Left out: derating, parasitic modes and prediction. Fingers
are points, and of several slipping fingers only the signs are free, not the phases.

The reach of one slipping finger is a linear program: maximise p.W with |W_k| <= L_k and A W = 0, where A holds the
still fingers' shapes. Its dual is a least absolute deviation: minimise sum_k L_k |p_k - (A'v)_k| over v. At an optimum
rank(A) of these terms vanish, so trying each such set of modes finds it; with one still finger that is a weighted
median (Bloomfield and Steiger, Least Absolute Deviations, 1983).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.public import solve_batch
from hapticd.values import FloatArray

from ..values import OnProgress

FULL_FRAC = 1.0 - 1e-9  # tolerates the solver's rounding of a target that is met
_RANK_FRAC = 1e-12  # of the largest singular value: below it a still finger repeats the others


class MapFinger(NamedTuple):
    """Position and target amplitude of a finger that does not move over the plate; 0 um is still."""

    x_mm: float
    y_mm: float
    target_um: float


@dataclass(frozen=True, slots=True)
class AchievabilityMap:
    """Results for one more finger at each cell's centre: arrays (ny, nx).

    `target_um` (N + 1,): the targets, the other finger's last, as in `achieved_um` (N + 1, ny, nx). `share`: achieved
    over target of the worst served slipping finger, at most 1; NaN without a slipping finger. `reach_um`: the largest
    amplitude of the one slipping finger; NaN with several. `slope_um_mm`: the steepest amplitude at a still finger, 0
    without one. `determinant`: of the mode matrix, zero on singular curves; NaN where it is not square.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    target_um: FloatArray
    share: FloatArray
    achieved_um: FloatArray
    reach_um: FloatArray
    slope_um_mm: FloatArray
    determinant: FloatArray

    def served_frac(self, share: float) -> float:
        """Return the fraction of the plate where every slipping finger gets at least this share of its target."""
        return float(np.mean(self.share >= share * FULL_FRAC))

    def contrast(self, position_error_mm: float) -> FloatArray:
        """Return the least slipping amplitude over that of a still finger off by `position_error_mm`, (ny, nx).

        inf where the still finger stands on no slope; NaN where nothing moves, or no finger slips, or none is still.
        """
        slips = self.target_um > 0.0
        if slips.all() or not slips.any():
            return np.full(self.share.shape, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.achieved_um[slips].min(axis=0) / (self.slope_um_mm * position_error_mm))


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


def achievability_map(
    modes: ModeShapes,
    fingers: Sequence[MapFinger],
    other_um: float,
    limit_um: Sequence[float],
    *,
    size_mm: tuple[float, float],
    cells: int,
    progress: OnProgress = lambda _: None,
) -> AchievabilityMap:
    """Return the map of cells x cells over a plate of `size_mm`; limit_um (M,). Raises ValueError as `solve`.

    `progress` is called with the share that is done.
    """
    x_mm, y_mm, points_mm = cell_centres(size_mm, cells)
    phi, target_um = _mode_matrices(modes, fingers, points_mm), _targets(fingers, other_um)
    rows = []
    for row, shapes in enumerate(np.split(phi, cells)):
        progress(row / cells)
        rows.append(solve_batch(shapes, target_um, limit_um))
    modal_um = np.concatenate(rows)
    achieved_um = np.abs(np.einsum("knm,km->kn", phi, modal_um))
    grid = (cells, cells)
    return AchievabilityMap(
        x_mm=x_mm,
        y_mm=y_mm,
        target_um=target_um,
        share=_share(achieved_um, target_um).reshape(grid),
        achieved_um=achieved_um.T.reshape(-1, *grid),
        reach_um=_reach_of_one(phi, target_um, limit_um).reshape(grid),
        slope_um_mm=_slope_um_mm(modes, fingers, points_mm, target_um, modal_um).reshape(grid),
        determinant=_determinant(phi).reshape(grid),
    )


def pair_map(
    modes: ModeShapes,
    target_um: float,
    limit_um: Sequence[float],
    *,
    size_mm: tuple[float, float],
    cells: int,
    progress: OnProgress = lambda _: None,
) -> PairMap:
    """Count the pairs where the slipping finger reaches `target_um`; limit_um (M,). It takes time of order
    cells^4, and shows the positions that lower the mean, which random pairs would not. `progress` is called with
    the share that is done."""
    x_mm, y_mm, points_mm = cell_centres(size_mm, cells)
    phi, limits = modes.evaluate(points_mm), np.asarray(limit_um, np.float64)
    slipping, still = np.zeros(len(phi)), np.zeros(len(phi))
    for places, basis in row_spaces(phi[:, None, :]):
        for here, shapes in enumerate(phi):
            progress(here / len(phi))
            reach_um = least_deviation(np.broadcast_to(shapes, (len(places), modes.M)), basis, limits)
            served = reach_um >= target_um * FULL_FRAC
            slipping[here] += np.count_nonzero(served)
            still[places] += served
    grid = (cells, cells)
    return PairMap(x_mm, y_mm, (slipping / len(phi)).reshape(grid), (still / len(phi)).reshape(grid))


def cell_centres(size_mm: tuple[float, float], cells: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x_mm (cells,), y_mm (cells,) and all centres (cells^2, 2), by rows, of cells that tile the plate."""
    x_mm, y_mm = (edge_mm * ((np.arange(cells) + 0.5) / cells - 0.5) for edge_mm in size_mm)
    return x_mm, y_mm, np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)


def achievable_share(
    modes: ModeShapes,
    fingers: Sequence[MapFinger],
    other_um: float,
    limit_um: Sequence[float],
    points_mm: npt.ArrayLike,
) -> FloatArray:
    """Return `AchievabilityMap.share` (K,) at `points_mm` (K, 2) of the other finger: in closed form with one slipping
    finger, by the solver with several."""
    phi, target_um = _mode_matrices(modes, fingers, np.asarray(points_mm, np.float64)), _targets(fingers, other_um)
    if np.count_nonzero(target_um) == 1:
        return np.asarray(np.minimum(_reach_of_one(phi, target_um, limit_um) / target_um.max(), 1.0))
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


def _reach_of_one(phi: FloatArray, target_um: FloatArray, limit_um: Sequence[float]) -> FloatArray:
    slips = target_um > 0.0
    if np.count_nonzero(slips) != 1:
        return np.full(len(phi), np.nan)
    return reach_um(phi[:, slips][:, 0], phi[:, ~slips], limit_um)


def _slope_um_mm(
    modes: ModeShapes, fingers: Sequence[MapFinger], points_mm: FloatArray, target_um: FloatArray, modal_um: FloatArray
) -> FloatArray:
    """Return the largest |grad W| at a still finger (K,)."""
    steepest = np.zeros(len(points_mm))
    places = [np.array([finger[:2]]) for finger in fingers]
    for place, target in zip([*places, points_mm], target_um, strict=True):
        if target == 0.0:
            slopes = np.broadcast_to(modes.gradient(place), (len(points_mm), modes.M, 2))
            steepest = np.maximum(steepest, np.hypot(*np.einsum("kmd,km->dk", slopes, modal_um)))
    return steepest


def _determinant(phi: FloatArray) -> FloatArray:
    _, fingers, modes = phi.shape
    return np.asarray(np.linalg.det(phi)) if fingers == modes else np.full(len(phi), np.nan)
