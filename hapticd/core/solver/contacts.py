"""Contacts that are discs, not points: a still finger's |w_i|^2 becomes its mean over the contact, W' G_i W.

G_i (M, M) is the mean of phi_k phi_l over the disc. No amplitude but 0 stills a whole disc, so rule (2) asks for what
it can have: as many directions of W are given up as the points would take, and those left are the ones in which the
discs move least, eigenvectors of the sum of G_i. At radius 0 that is the point's rule. The directions given up enter
the solver as still fingers' rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .arithmetic import Row
from .checks import FloatArray, Rows
from .plane import common_direction
from .polytope import RANK


def contact_problem(rows: Rows, targets: Row, grams: FloatArray) -> tuple[Rows, Row]:
    """Rows and targets with the still fingers' points replaced by their discs' principal axes; grams (N, M, M)."""
    still = [index for index, target in enumerate(targets) if target == 0.0]
    rank = _rank([rows[index] for index in still])
    if rank == 0:
        return rows, targets
    slipping = [index for index, target in enumerate(targets) if target != 0.0]
    axes = principal_axes(grams[still], rank)
    return (*(rows[index] for index in slipping), *axes), (*(targets[index] for index in slipping), *(0.0,) * rank)


def contact_track(track: Sequence[Rows], targets: Sequence[Row], grams: FloatArray) -> tuple[list[Rows], list[Row]]:
    """As `contact_problem` for each of K instants; grams (K, N, M, M)."""
    problems = [contact_problem(*instant) for instant in zip(track, targets, grams, strict=True)]
    return [rows for rows, _ in problems], [wanted for _, wanted in problems]


def principal_axes(grams: FloatArray, count: int) -> Rows:
    """The `count` directions of W, as rows, in which these discs (n, M, M) together move most."""
    if count == 1 and grams.shape == (1, 2, 2):
        return (_axis_of_disc(*grams[0].ravel().tolist()),)
    size = float(np.max(np.abs(grams)))
    together = np.sum(grams / size, axis=0) if size > 0.0 else grams[0]
    if count == 1 and len(together) == 2:
        return (_axis_of_disc(*together.ravel().tolist()),)
    _, vectors = np.linalg.eigh((together + together.T) / 2)
    return tuple(map(tuple, vectors.T[-count:].tolist()))


def principal_axis(xx: float, xy: float, yy: float) -> tuple[float, float]:
    """The unit vector along which the 2 x 2 form (xx xy; xy yy) is greatest: the row of one still disc on two modes."""
    angle_rad = math.atan2(2.0 * xy, xx - yy) / 2
    return math.cos(angle_rad), math.sin(angle_rad)


def _axis_of_disc(xx: float, xy: float, yx: float, yy: float) -> tuple[float, float]:
    """`principal_axis` at any scale."""
    size = max(abs(xx), abs(xy), abs(yx), abs(yy))
    if size == 0.0:
        return 1.0, 0.0
    return principal_axis(xx / size, (xy / size + yx / size) / 2, yy / size)


def _rank(still: list[Row]) -> int:
    moved = [row for row in still if any(row)]
    if not moved:
        return 0
    if len(moved) == 1 or len(moved[0]) == 1:
        return 1
    if len(moved[0]) == 2:
        return 1 if common_direction(moved) is not None else 2
    sizes = np.max(np.abs(moved), axis=1, keepdims=True)
    singular = np.linalg.svd(np.array(moved) / sizes, compute_uv=False)
    return int(np.count_nonzero(singular > RANK * singular[0]))
