"""Least squares within |C z| <= h, of all minima the one of least norm: a primal active-set method.

Stage one minimises |A z - b| from z = 0, which is always inside: step to the minimum on the current face; a limit met
on the way joins the face, a limit whose multiplier points inward leaves it (Nocedal & Wright, Numerical Optimization,
section 16.5). Stage two does the same for |z| along the directions that A does not see. Every iterate is within the
limits, so the result is safe however many steps it takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ....values import FloatArray

_ALONG_FACE = 1e-13  # the part of a step across a limit below this share of the step is rounding
RANK = 1e-13  # singular values below this share of the matrix are rounding
_PULL = 1e-12  # multipliers below this share of the forces at work are rounding
_STEPS_PER_LIMIT = 20  # degenerate corners take a few; the cap only guards against cycling


@dataclass(frozen=True, slots=True)
class Factored:
    """A matrix by its singular value decomposition, cut at its numerical rank."""

    matrix: FloatArray  # (n, r)
    left: FloatArray  # (n, rank)
    singular: FloatArray  # (rank,)
    right: FloatArray  # (rank, r)
    unseen: FloatArray  # (r, r - rank): directions that the matrix does not see

    @classmethod
    def of(cls, matrix: FloatArray) -> Factored:
        """Factor a matrix (n, r)."""
        left, singular, right = np.linalg.svd(matrix, full_matrices=True)
        rank = int(np.count_nonzero(singular > RANK * singular[0]))
        return cls(matrix, left[:, :rank], singular[:rank], right[:rank], right[rank:].T)

    def least_norm(self, b: FloatArray) -> FloatArray:
        """The least-norm minima (count, r) of |A z - b| for each row of b (count, n)."""
        z: FloatArray = ((b @ self.left) / self.singular) @ self.right  # this order of operations keeps it stable
        return z


def least_norm_in_polytope(
    factored: Factored, b: FloatArray, free: FloatArray, c: FloatArray, h: FloatArray
) -> FloatArray:
    """The z (r,) with |C z| <= h that minimises |A z - b|, then |z|; C (M, r), h (M,). `free` is z without limits."""
    normals, bounds = np.vstack([c, -c]), np.concatenate([h, h])
    z = descend(factored.matrix, b, normals, bounds, free)
    unseen = factored.unseen
    if unseen.shape[1] == 0:
        return z
    slack = np.maximum(bounds - normals @ z, 0.0)
    inward = -(unseen.T @ z)
    x = descend(np.eye(len(inward)), inward, normals @ unseen, slack, inward)
    return z + unseen @ x


def descend(a: FloatArray, b: FloatArray, normals: FloatArray, bounds: FloatArray, free: FloatArray) -> FloatArray:
    """argmin |A z - b| subject to normals z <= bounds (bounds >= 0), from z = 0, by the shortest way.

    `free` is the least-norm minimum without bounds: the first step.
    """
    seen = RANK * math.sqrt(float(np.sum(a * a)))
    z, step = np.zeros(a.shape[1]), free
    face: list[int] = []
    for count in range(_STEPS_PER_LIMIT * len(bounds)):
        if count > 0:
            step = _step_on_face(a, b - a @ z, normals[face], seen)
        blocking, share = _first_limit(normals, bounds, face, z, step)
        z = z + share * step
        if blocking is not None:
            face.append(blocking)
            continue
        leaving = _inward_pull(a, b - a @ z, normals[face], b)
        if leaving is None:
            return z
        del face[leaving]
    return z


def _step_on_face(a: FloatArray, residual: FloatArray, held: FloatArray, seen: float) -> FloatArray:
    """From here to the minimum of the face, by the shortest way."""
    if len(held) == 0:
        return shortest(a, residual, seen)
    _, singular, right = np.linalg.svd(held)
    free = right[np.count_nonzero(singular > _ALONG_FACE * singular[0]) :].T
    if free.shape[1] == 0:
        return np.zeros(a.shape[1])
    return free @ shortest(a @ free, residual, seen)


def shortest(a: FloatArray, b: FloatArray, seen: float) -> FloatArray:
    """The least-norm minimum of |A x - b|, moving only in directions with a singular value above `seen`."""
    left, singular, right = np.linalg.svd(a, full_matrices=False)
    rank = int(np.count_nonzero(singular > seen))
    x: FloatArray = right[:rank].T @ ((left[:, :rank].T @ b) / singular[:rank])
    return x


def _first_limit(
    normals: FloatArray, bounds: FloatArray, face: list[int], z: FloatArray, step: FloatArray
) -> tuple[int | None, float]:
    """The limit that the step meets first, if any, and the share of the step up to there."""
    outward = normals @ step
    slack = np.maximum(bounds - normals @ z, 0.0)
    outward[face] = 0.0
    meets = outward > np.maximum(slack, _ALONG_FACE * np.max(np.abs(step), initial=0.0))
    if not np.any(meets):
        return None, 1.0
    share = np.where(meets, slack / np.where(meets, outward, 1.0), np.inf)
    blocking = int(np.argmin(share))
    return blocking, float(share[blocking])


def _inward_pull(a: FloatArray, residual: FloatArray, held: FloatArray, b: FloatArray) -> int | None:
    """The held limit from which the minimum lies inward the most; None at the constrained minimum."""
    if len(held) == 0:
        return None
    force = a.T @ residual
    multipliers = shortest(held.T, force, RANK * math.sqrt(float(np.sum(held * held))))
    largest = np.max(np.abs(a))
    noise = _PULL * largest * float(np.max(np.abs(residual))) + 1e-15 * largest * float(np.max(np.abs(b)))
    leaving = int(np.argmin(multipliers))
    return leaving if multipliers[leaving] < -noise else None
