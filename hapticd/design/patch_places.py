"""Places for piezoelectric patches along a plate's edges, one to drive and one to sense for each mode, and for stamps.

A thin patch on one face pulls at its edges with a force that is uniform along them, so that it drives a mode by what
they move apart, and as a sensor gives charge in the same proportion (Crawley and de Luis, AIAA J. 25 (1987) 1373).
These couplings, each as a share of the mode's best, are the drive and sense matrices up to a factor per mode. The
patches that are chosen are those whose worst needs the least volts.

A stamp supports the plate where all modes move it least. It is a disc, which the slope of the shapes moves. Damping,
and the shaking of a sensor under the plate, grow with the largest motion within the disc.

Left out: the patch's own stiffness and mass in the shapes (`glued_plate` has them), wires, and the glue.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..values import FloatArray
from . import legendre
from .glued_plate import Patch
from .mode_shape import ModeShape

BoolArray = npt.NDArray[np.bool_]

STEP_MM = 2.5  # between candidates along an edge
_GAUSS_POINTS = 8  # per side of a patch, which is shorter than a wave
_SINGULAR = 1e-9  # smaller pivots are none
_CELLS_PER_WAVE = 12  # of the grid on which stamps are searched
_DISC_RADII, _DISC_ANGLES = 4, 16  # sample points of a disc
_TRIED = 50  # cells of least motion in each quadrant whose whole disc is judged
_INNER_FRAC = 0.25  # of the half plate: four stamps nearer to the middle let the plate tip
_ROUNDS = 20  # of exchanges; five suffice on four modes


@dataclass(frozen=True, slots=True)
class PatchSet:
    """Patches for M modes: centres (M, 2) in mm, couplings (M modes, M patches) as shares of each mode's best."""

    places_mm: FloatArray
    coupling: FloatArray

    @property
    def condition(self) -> float:
        """Return the ratio of the matrix's largest singular value to its least."""
        return float(np.linalg.cond(self.coupling))


def place_patches(
    shapes: Sequence[ModeShape], patch_mm: tuple[float, float], height_mm: float, taken: Sequence[Patch] = ()
) -> PatchSet:
    """Return a patch to sense, or to drive, each mode, of `patch_mm` (width, depth), none over another or `taken`;
    `height_mm` is that of its middle above the plate's.

    Raises ValueError for a patch that is too large for the plate's edges.
    """
    candidates_mm = edge_places(shapes[0].size_mm, patch_mm)
    for patch in taken:
        room_mm = (np.array(patch_mm) + np.array(patch.size_mm)) / 2.0
        away_mm = np.abs(candidates_mm - np.array((patch.x_mm, patch.y_mm)))
        candidates_mm = candidates_mm[np.any(away_mm >= room_mm - 1e-9, axis=1)]
    coupling = couplings(shapes, candidates_mm, patch_mm, height_mm)
    coupling /= np.max(np.abs(coupling), axis=1, keepdims=True)
    overlaps = overlapping(candidates_mm, np.broadcast_to(np.array(patch_mm), candidates_mm.shape))
    chosen = places_for_reach(coupling, overlaps)
    return PatchSet(candidates_mm[chosen], coupling[:, chosen])


def edge_places(size_mm: tuple[float, float], patch_mm: tuple[float, float]) -> FloatArray:
    """Return the centres (n, 2) of patches that lie along the four edges, corners included. Raises ValueError."""
    reach_mm = [(edge_mm - patch) / 2.0 for edge_mm, patch in zip(size_mm, patch_mm, strict=True)]
    if min(reach_mm) <= min(size_mm) / 4.0:
        raise ValueError(f"patches of {patch_mm[0]:g}x{patch_mm[1]:g} mm are too large for the plate's edges.")
    along = [np.linspace(-reach, reach, 2 * round(reach / STEP_MM) + 1) for reach in reach_mm]
    sides = [(x_mm, side * reach_mm[1]) for side in (-1, 1) for x_mm in along[0]]
    sides += [(side * reach_mm[0], y_mm) for side in (-1, 1) for y_mm in along[1][1:-1]]
    return np.array(sides)


def along_edges(size_mm: tuple[float, float], patch_mm: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return centres and sizes (n, 2) of patches along the four edges, of either orientation. Raises ValueError."""
    turns = {patch_mm, patch_mm[::-1]}
    found = [edge_places(size_mm, turned) for turned in sorted(turns)]
    sizes = [np.broadcast_to(turned, places.shape) for turned, places in zip(sorted(turns), found, strict=True)]
    return np.concatenate(found), np.concatenate(sizes)


def couplings(
    shapes: Sequence[ModeShape], places_mm: FloatArray, patch_mm: npt.ArrayLike, height_mm: npt.ArrayLike
) -> FloatArray:
    """Return the stretch (M, n) of a patch at each of `places_mm` (n, 2), of all its area, in mm per mm of a mode: what
    its edges move apart. `height_mm` is that of its middle above the plate's.

    `patch_mm` is the width and depth of all of them (2,), or of each (n, 2)."""
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    size = np.array(shapes[0].size_mm)
    half = np.broadcast_to(np.asarray(patch_mm, np.float64) / 2.0, places_mm.shape)
    ends = (places_mm[:, None] + half[:, None] * np.array((-1.0, 1.0))[:, None]) * (2.0 / size)  # (n, end, 2)
    inside = (places_mm[:, None] + half[:, None] * points[:, None]) * (2.0 / size)  # of the rule along each side
    degrees = [terms - 1 for terms in shapes[0].coefficients.shape]

    def values(places: FloatArray, degree: int) -> FloatArray:
        return legendre.values(places.ravel(), degree).reshape(*places.shape, degree + 1)

    apart = [np.diff(values(ends[..., axis], degrees[axis]), axis=1)[:, 0] for axis in (0, 1)]
    over = [
        np.einsum("nqi,q,n->ni", values(inside[..., axis], degrees[axis]), weights, half[:, axis]) for axis in (0, 1)
    ]

    def stretch(of_x: FloatArray, of_y: FloatArray) -> FloatArray:
        across = np.einsum("ni,ij,nj->n", apart[0], of_x, over[1], optimize=True)
        return np.asarray(across + np.einsum("ni,ij,nj->n", over[0], of_y, apart[1], optimize=True))

    motions = [shape.solved_motion for shape in shapes]
    return np.array([stretch(*motion[2:]) + np.asarray(height_mm) * stretch(*motion[:2]) for motion in motions])


def places_for_reach(per_volt_um: FloatArray, overlaps: BoolArray) -> list[int]:
    """Return a candidate for each mode, by what a volt on each gives the modes, `per_volt_um` (M, n): those whose worst
    patch needs the least volts, RMS, when all modes have the same amplitude in any phases.

    The volts are rows of the inverse of the chosen columns A. With another candidate c in the place of column j, and
    u = A^-1 c, row i becomes row i less u_i / u_j of row j (J. Sherman and W. J. Morrison, Ann. Math. Stat. 21 (1950)
    124), so all candidates are compared by products of rows.
    """
    chosen = _greedy(per_volt_um / np.linalg.norm(per_volt_um, axis=1, keepdims=True), overlaps)
    for _ in range(_ROUNDS):
        before = list(chosen)
        for place in range(len(chosen)):
            tried = np.flatnonzero(~overlaps[chosen[:place] + chosen[place + 1 :]].any(axis=0))
            volts_per_um = np.linalg.inv(per_volt_um[:, chosen])
            squares = volts_per_um @ volts_per_um.T
            u = volts_per_um @ per_volt_um[:, tried]
            u_j = np.where(np.abs(u[place]) < _SINGULAR, _SINGULAR, u[place])
            share = u / u_j
            rows = np.diag(squares)[:, None] + share * (share * squares[place, place] - 2.0 * squares[place][:, None])
            rows[place] = squares[place, place] / u_j**2
            chosen[place] = int(tried[np.argmin(np.round(np.log(rows.max(axis=0)), 9))])
        if chosen == before:
            break
    return chosen


def overlapping(places_mm: FloatArray, patch_mm: FloatArray) -> BoolArray:
    """Return which patches, centres and sizes (n, 2), lie over which others (n, n)."""
    room_mm = (patch_mm[:, None] + patch_mm) / 2.0
    return np.asarray(np.all(np.abs(places_mm[:, None] - places_mm) < room_mm - 1e-9, axis=2))


def _greedy(coupling: FloatArray, overlaps: BoolArray) -> list[int]:
    """Return one candidate per mode: each the largest of what the ones before leave."""
    chosen: list[int] = []
    left = coupling.copy()
    for _ in coupling:
        size = np.where(overlaps[chosen].any(axis=0), -1.0, np.linalg.norm(left, axis=0))
        chosen.append(int(np.argmax(size)))
        along = left[:, chosen[-1]] / np.linalg.norm(left[:, chosen[-1]])
        left = left - np.outer(along, along @ left)
    return chosen


class Stamp(NamedTuple):
    """A support point, and the largest motion within the disc around it, as a share of the amplitude of all modes, in
    phase."""

    x_mm: float
    y_mm: float
    moved_frac: float


def four_stamps(shapes: Sequence[ModeShape], radius_mm: float) -> tuple[Stamp, ...]:
    """Return the point with room for a stamp of `radius_mm` where all `shapes` move it least in each quadrant, away
    from the middle: on a grid, a twelfth of the shortest wave apart."""
    lines = max(max(shape.nodal_lines) for shape in shapes) + 2
    x_mm, y_mm = (
        np.linspace(-1.0, 1.0, _CELLS_PER_WAVE * lines) * (edge_mm / 2 - radius_mm) for edge_mm in shapes[0].size_mm
    )
    size = np.sum([np.abs(shape.on_grid(x_mm, y_mm)) for shape in shapes], axis=0)
    inner_x_mm, inner_y_mm = (_INNER_FRAC * edge_mm / 2 for edge_mm in shapes[0].size_mm)
    chosen = []
    for right, up in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        quarter = np.where(np.outer(up * y_mm >= inner_y_mm, right * x_mm >= inner_x_mm), size, np.inf)
        rows, columns = np.unravel_index(np.argsort(quarter, axis=None, kind="stable")[:_TRIED], size.shape)
        points = np.stack((x_mm[columns], y_mm[rows]), axis=-1)
        moved = _moved(shapes, points, radius_mm)
        best = int(np.argmin(np.round(moved, 9)))
        chosen.append(Stamp(float(points[best, 0]), float(points[best, 1]), float(moved[best])))
    return tuple(chosen)


def _moved(shapes: Sequence[ModeShape], points: FloatArray, radius_mm: float) -> FloatArray:
    """Return the largest sum of |shape| within each disc (N,)."""
    radii = radius_mm * np.arange(1, _DISC_RADII + 1) / _DISC_RADII
    angles = 2.0 * np.pi * np.arange(_DISC_ANGLES) / _DISC_ANGLES
    disc = (radii[:, None, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)).reshape(-1, 2)
    around = (points[:, None] + disc).reshape(-1, 2)
    size = sum(np.abs(shape.evaluate(around)) for shape in shapes)
    return np.asarray(np.reshape(size, (len(points), len(disc))).max(axis=1), np.float64)
