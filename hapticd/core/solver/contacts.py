"""Contacts that are discs, not points: a still finger's |w_i|^2 becomes its mean over the contact, W' G_i W.

G_i (M, M) is the mean of phi_k phi_l over the disc. No amplitude but 0 stills a whole disc, so rule (2) of `public` is
weakened: as many directions of W are given up as the points would take, and those left are the ones in which the
discs move least, eigenvectors of the sum of G_i. At radius 0 that is the point's rule. The directions given up enter
the solver as still fingers' rows.
"""

from __future__ import annotations

import numpy as np

from .arithmetic import Row, Rows
from .general import FloatArray, null_basis


def contact_problem(rows: Rows, targets: Row, grams: FloatArray) -> tuple[Rows, Row]:
    """Rows and targets with the still fingers' points replaced by their discs' principal axes; grams (N, M, M)."""
    still = [index for index, target in enumerate(targets) if target == 0.0]
    rank = len(grams[0]) - null_basis([rows[index] for index in still], len(grams[0])).shape[1] if still else 0
    if rank == 0:
        return rows, targets
    slipping = [index for index, target in enumerate(targets) if target != 0.0]
    axes = principal_axes(grams[still], rank)
    return (*(rows[index] for index in slipping), *axes), (*(targets[index] for index in slipping), *(0.0,) * rank)


def principal_axes(grams: FloatArray, count: int) -> Rows:
    """The `count` directions of W, as rows, in which these discs (n, M, M) together move most."""
    size = float(np.max(np.abs(grams)))
    together = np.sum(grams / size, axis=0) if size > 0.0 else grams[0]
    _, vectors = np.linalg.eigh((together + together.T) / 2)
    return tuple(map(tuple, vectors.T[-count:].tolist()))
