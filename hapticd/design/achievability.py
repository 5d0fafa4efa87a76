"""Where one finger more can get its wish: for fingers that are here, what each place of the plate has for another.

Two fingers share the plate's modes, and some pairs of places cannot have both wishes. For every place of another finger
that is to be still, or to slip, the map says what the slipping fingers get, still ones being held at exactly zero, by
the rules of `core.solver` (`keep_zero` without effort). What a real touch loses beside is left out: fade, neighbouring
modes, prediction. Fingers are points, and of several that slip only the signs are free, not the phases.

How far one slipping finger could get is a linear program: the most p.W with |W_k| <= L_k and A W = 0, A holding the
still fingers' shapes. Its dual is to bring p as near to A's rows as can be: the least over v of
sum_k L_k |p_k - (A'v)_k|. As many of these terms as A has rank vanish at a best v, so trying each such set of modes
finds it; with one still finger that is a weighted median (Bloomfield and Steiger, Least Absolute Deviations, 1983).
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

from .legendre import FloatArray

FULL_FRAC = 1.0 - 1e-9  # the solver's rounding takes nothing from a finger that gets what it asked for
_RANK_FRAC = 1e-12  # of the largest singular value: below it a still finger only repeats the others


class Finger(NamedTuple):
    """A finger that stays where it is, and what it should get; 0 is still."""

    x_mm: float
    y_mm: float
    target_um: float


@dataclass(frozen=True, slots=True)
class AchievabilityMap:
    """What places have for another finger, at the cells' centres: arrays (ny, nx).

    `target_um` (N + 1,): what was asked for, the other finger's last, as in `achieved_um` (N + 1, ny, nx). `share`: of
    its target, what the slipping finger that fares worst gets; 1 is as asked, NaN where nobody slips. `reach_um`: what
    the one slipping finger could get if it asked for more; NaN where several slip. `slope_um_mm`: how fast vibration
    rises about the still finger that has it worst, 0 where none is still. `determinant`: of the mode matrix, zero on
    singular curves; NaN where it is not square.
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
        """The part of the plate where every slipping finger gets at least this share of its target."""
        return float(np.mean(self.share >= share * FULL_FRAC))

    def contrast(self, position_error_mm: float) -> FloatArray:
        """What the least served slipping finger gets, over what a still one gets that is off by `position_error_mm`.

        (ny, nx); inf where the still finger stands on no slope, NaN where nothing moves, nobody slips or none is still.
        """
        slips = self.target_um > 0.0
        if slips.all() or not slips.any():
            return np.full(self.share.shape, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.achieved_um[slips].min(axis=0) / (self.slope_um_mm * position_error_mm))


def achievability_map(
    modes: ModeShapes,
    fingers: Sequence[Finger],
    other_um: float,
    limit_um: Sequence[float],
    *,
    size_mm: tuple[float, float],
    cells: int,
) -> AchievabilityMap:
    """The map over a plate of `size_mm`, in cells x cells; limit_um (M,). Raises ValueError as `core.solver.solve`."""
    x_mm, y_mm, points_mm = cell_centres(size_mm, cells)
    phi, target_um = _mode_matrices(modes, fingers, points_mm), _targets(fingers, other_um)
    modal_um = solve_batch(phi, target_um, limit_um)
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


def cell_centres(size_mm: tuple[float, float], cells: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x_mm (cells,), y_mm (cells,) and all places (cells^2, 2), by rows, of cells that tile the plate."""
    x_mm, y_mm = (edge_mm * ((np.arange(cells) + 0.5) / cells - 0.5) for edge_mm in size_mm)
    return x_mm, y_mm, np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)


def achievable_share(
    modes: ModeShapes,
    fingers: Sequence[Finger],
    other_um: float,
    limit_um: Sequence[float],
    points_mm: npt.ArrayLike,
) -> FloatArray:
    """`AchievabilityMap.share` alone, at `points_mm` (K, 2) of the other finger: (K,). With one slipping finger it is
    the closed form, otherwise the solver's."""
    phi, target_um = _mode_matrices(modes, fingers, np.asarray(points_mm, np.float64)), _targets(fingers, other_um)
    if np.count_nonzero(target_um) == 1:
        return np.asarray(np.minimum(_reach_of_one(phi, target_um, limit_um) / target_um.max(), 1.0))
    achieved_um = np.abs(np.einsum("knm,km->kn", phi, solve_batch(phi, target_um, limit_um)))
    return _share(achieved_um, target_um)


def reach_um(slipping: FloatArray, still: FloatArray, limit_um: npt.ArrayLike) -> FloatArray:
    """The most |slipping . W| over |W_k| <= limit_k with still W = 0: (K,) in um.

    slipping (K, M) and still (K, S, M): the shapes under the slipping finger and under the S still ones.
    """
    limits = np.broadcast_to(np.asarray(limit_um, np.float64), slipping.shape[1:])
    reach = np.full(len(slipping), np.inf)
    for cells, basis in row_spaces(still):
        reach[cells] = least_deviation(slipping[cells], basis, limits)
    return reach


def row_spaces(still: FloatArray) -> Iterator[tuple[npt.NDArray[np.intp], FloatArray]]:
    """By rank: which instants have it, and orthonormal rows (cells, rank, M) that span what their still fingers do."""
    if still.shape[1] == 0:
        yield np.arange(len(still)), still
        return
    _, sizes, rows = np.linalg.svd(still, full_matrices=False)
    ranks = np.count_nonzero(sizes > _RANK_FRAC * sizes[:, :1], axis=1)
    for rank in np.unique(ranks):
        cells = np.flatnonzero(ranks == rank)
        yield cells, rows[cells, :rank]


def least_deviation(slipping: FloatArray, basis: FloatArray, limits: FloatArray) -> FloatArray:
    """The least of sum_k L_k |p_k - (B'v)_k| over v, p = slipping (K, M), B = basis (K, rank, M)."""
    rank, modes = basis.shape[1:]
    least = np.full(len(slipping), np.inf)
    for chosen in map(list, combinations(range(modes), rank)):
        square = basis[:, :, chosen].transpose(0, 2, 1)
        singular = np.linalg.det(square) == 0.0
        square = np.where(singular[:, None, None], np.eye(rank), square)
        v = np.linalg.solve(square, slipping[:, chosen, None])[..., 0]
        deviation = np.abs(slipping - np.einsum("krm,kr->km", basis, v))
        deviation[:, chosen] = 0.0  # but for rounding, which near-singular sets make large
        least = np.where(singular, least, np.minimum(least, deviation @ limits))
    return least


def _mode_matrices(modes: ModeShapes, fingers: Sequence[Finger], points_mm: FloatArray) -> FloatArray:
    """Phi (K, N + 1, M) with the other finger at each of the points, as its last row."""
    here = modes.evaluate(np.array([finger[:2] for finger in fingers], np.float64).reshape(-1, 2))
    there = modes.evaluate(points_mm)[:, None, :]
    return np.concatenate((np.broadcast_to(here, (len(points_mm), *here.shape)), there), axis=1)


def _targets(fingers: Sequence[Finger], other_um: float) -> FloatArray:
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
    modes: ModeShapes, fingers: Sequence[Finger], points_mm: FloatArray, target_um: FloatArray, modal_um: FloatArray
) -> FloatArray:
    """|grad W| under the still finger where it is largest (K,)."""
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
