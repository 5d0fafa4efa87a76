"""The best of all signs, N fingers on M modes on arrays: null space, sign patterns, least squares within the limits.

The still fingers leave a subspace of modal amplitudes, W = basis z (singular value decomposition; rows are scaled to
a largest entry of 1, ranks are cut at `RANK`). For every sign pattern of the slipping fingers the minimum-norm
least-squares z is computed, all patterns at once. Without limits it is a lower bound of the pattern's error; only
where z leaves the box |W_k| <= limit_k and the bound beats the best so far does the active set of `polytope` run.

Cost, n slipping fingers: 2^(n-1) patterns up to n = 10, beyond that a local search over single signs from n + M starts.
A pattern costs O(n M); where limits bind, some 2 M decompositions of O(n M^2) each. For
`solve`, not for the touch path. Not compiled: NumPy does the work.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ....values import FloatArray
from ...phasors import EQUAL_ERROR, EQUAL_NORM, MISSED, NOISE, SAFE, ModeRow, ModeRows, all_finite, clamped
from .polytope import RANK, Factored, least_norm_in_polytope

_MOST_ENUMERATED: Final = 10  # slipping fingers: 512 patterns
_REACH_CAP: Final = 1e30  # a target so many times out of reach acts like any farther one
_SURELY_GREATER: Final = 1.0 + 1e-6  # of |W|^2: no tie


# --- the problem ----------------------------------------------------------------------------------------------------


class PointProblem(NamedTuple):
    """What the still fingers leave to the n slipping ones, scaled to a largest gain and a largest limit of 1.

    W = reach * basis z, and each slipping finger gets gains z.
    """

    basis: FloatArray  # (M, r), orthonormal
    gains: FloatArray  # (n, r)
    box: FloatArray  # (M,)
    targets: FloatArray  # (n,)
    reach: float
    factored: Factored  # the gains

    def best(self, previous: ModeRow | None) -> tuple[list[float], bool]:
        """Return the best amplitudes (M,) of all signs, in units of the reach, of equals those nearest `previous`; and
        whether a limit bent them, and some finger misses its target by more than rounding."""
        one = _best_of_all(self, previous)
        is_missed = not np.all(np.abs(one.amplitudes - self.targets) <= MISSED * self.targets)
        return one.modal.tolist(), one.is_bent and is_missed


class Candidate(NamedTuple):
    """Solution of one sign pattern; `error` and `square` order candidates by rules (3) and (4)."""

    modal: FloatArray  # (M,)
    amplitudes: FloatArray  # (n,), 0 or more
    signs: FloatArray  # (n,)
    error: float  # squared error less the targets' squares, which may dwarf it
    square: float  # |W|^2
    is_bent: bool


def pose(rows: ModeRows, targets: ModeRow, limits: ModeRow) -> PointProblem | None:
    """The problem; None where only silence serves: no finger slips or can be moved, or phi is not finite."""
    still = [row for row, target in zip(rows, targets, strict=True) if target == 0.0]
    slipping = [row for row, target in zip(rows, targets, strict=True) if target != 0.0]
    if not slipping or not all_finite(rows):
        return None
    basis = null_basis(still, len(limits))
    phi = np.array(slipping)
    size = float(np.max(np.abs(phi)))
    if basis.shape[1] == 0 or size == 0.0:
        return None
    phi = phi / size
    gains = phi @ basis
    gains[np.abs(gains) <= NOISE * (np.abs(phi) @ np.abs(basis))] = 0.0
    largest = float(np.max(np.abs(gains)))
    if largest == 0.0:
        return None
    gains /= largest
    requested = [target for target in targets if target != 0.0]
    reach, peak = max(limits), max(requested)
    scaled_peak = peak / max(size * largest, sys.float_info.min) / reach
    wanted = np.array(requested) / peak * (scaled_peak if scaled_peak <= _REACH_CAP else _REACH_CAP)
    return PointProblem(basis, gains, np.array(limits) / reach, wanted, reach, Factored.of(gains))


def null_basis(still: Sequence[ModeRow], modes: int) -> FloatArray:
    """Orthonormal columns (M, r) of the modal amplitudes that move no still finger."""
    sizes = [max([abs(value) for value in row]) for row in still]
    rows = [[value / size for value in row] for row, size in zip(still, sizes, strict=True) if size > 0.0]
    if not rows:
        return np.eye(modes)
    _, singular, right = np.linalg.svd(np.array(rows))
    rank = int(np.count_nonzero(singular > RANK * singular[0]))
    return np.ascontiguousarray(right[rank:].T)


# --- sign patterns --------------------------------------------------------------------------------------------------


def _best_of_all(problem: PointProblem, previous: ModeRow | None) -> Candidate:
    """The candidate with least error, of equals that of least |W|, of equals the one nearest `previous`."""
    modes = len(problem.box)
    near = np.array([0.0 if previous is None else clamped(previous[k] / problem.reach, SAFE) for k in range(modes)])
    moved = np.flatnonzero(problem.gains.any(axis=1))
    if len(moved) <= _MOST_ENUMERATED:
        return _nearest(problem, _solved(problem, _every_pattern(problem.gains, moved)), near)
    candidates = _solved(problem, _locally_best(problem, near))
    best, signs = _best(candidates), np.zeros(len(problem.gains))
    while not np.array_equal(best.signs, signs):
        signs = best.signs
        candidates += _solved(problem, np.where(np.eye(len(signs), dtype=bool)[moved], -signs, signs))
        best = _best(candidates)
    return _nearest(problem, candidates, near)


def _solved(problem: PointProblem, patterns: FloatArray) -> list[Candidate]:
    """Candidates of sign patterns (count, n); a pattern whose lower bound has lost is left out."""
    targets = problem.targets
    free = problem.factored.least_norm(patterns * targets)
    modal, got = free @ problem.basis.T, free @ problem.gains.T
    fits = np.all(np.abs(modal) <= problem.box, axis=1)
    got = np.where(fits[:, None], np.abs(got), patterns * got)
    errors, squares = np.sum(got * (got - 2.0 * targets), axis=1), np.sum(modal * modal, axis=1)
    candidates: list[Candidate] = []
    best: Candidate | None = None
    for index in np.lexsort((squares, errors, ~fits)).tolist():
        if best is not None and _has_lost(float(errors[index]), float(squares[index]), best, targets):
            continue
        one = Candidate(
            modal[index], got[index], patterns[index], float(errors[index]), float(squares[index]), not fits[index]
        )
        if one.is_bent:
            one = _bent(problem, patterns[index], free[index])
        candidates.append(one)
        best = one if best is None or one.error < best.error else best
    return candidates


def _bent(problem: PointProblem, signs: FloatArray, free: FloatArray) -> Candidate:
    """The best of a sign pattern within the limits; `free` (r,) is the best without them."""
    if len(free) == 1:  # a line: clamped
        line = np.abs(problem.basis[:, 0])
        top = float(np.min(problem.box[line > NOISE] / line[line > NOISE]))
        z = np.clip(free, -top, top)
    else:
        z = least_norm_in_polytope(problem.factored, signs * problem.targets, free, problem.basis, problem.box)
    modal, got = problem.basis @ z, np.abs(problem.gains @ z)
    return Candidate(modal, got, signs, float(got @ (got - 2.0 * problem.targets)), float(modal @ modal), True)


def _has_lost(error: float, square: float, best: Candidate, targets: FloatArray) -> bool:
    """A candidate with at least this error and |W|^2 cannot win."""
    equal = EQUAL_ERROR * float(targets @ best.amplitudes)
    return error > best.error + equal or (error >= best.error - equal and square > best.square * _SURELY_GREATER)


def _best(candidates: Sequence[Candidate]) -> Candidate:
    return min(candidates, key=lambda one: one.error)


def _nearest(problem: PointProblem, candidates: Sequence[Candidate], near: FloatArray) -> Candidate:
    """Rules (3), (4) and (5) among candidates; W or -W, which no finger can distinguish, whichever is nearer."""
    best = _best(candidates)
    allowed = best.error + EQUAL_ERROR * float(problem.targets @ best.amplitudes)
    equal = [one for one in candidates if one.error <= allowed]
    least = min([one.square for one in equal]) * (1.0 + EQUAL_NORM)
    equal = [one._replace(modal=-one.modal) if one.modal @ near < 0.0 else one for one in equal if one.square <= least]
    return min(equal, key=lambda one: float(np.sum((one.modal - near) ** 2)))


def _every_pattern(gains: FloatArray, moved: npt.NDArray[np.intp]) -> FloatArray:
    """All signs (count, n) of the fingers that can be moved, up to a common one; 1 for the others."""
    if gains.shape[1] == 1:  # a line: the fingers' signs are those of their gains
        return np.where(gains < 0.0, -1.0, 1.0).T
    free = max(len(moved) - 1, 0)
    patterns = np.ones((2**free, len(gains)))
    patterns[:, moved[1:]] = 1.0 - 2.0 * ((np.arange(2**free)[:, None] >> np.arange(free)) & 1)
    return patterns


def _locally_best(problem: PointProblem, near: FloatArray) -> FloatArray:
    """Signs that no single change improves, limits aside: s' kernel s is what of the targets' squares they serve.

    From every principal direction, every finger's own, and that of the present amplitudes.
    """
    gains, left = problem.gains, problem.factored.left
    kernel = (left @ left.T) * np.outer(problem.targets, problem.targets)
    directions = np.vstack([problem.factored.right, gains, near @ problem.basis])
    signs = np.where(directions @ gains.T >= 0.0, 1.0, -1.0)
    noise = 1e-12 * float(np.trace(kernel))
    lines = np.arange(len(signs))
    for _ in range(4 * len(gains)):
        improvement = np.diag(kernel) - signs * (signs @ kernel)
        best = np.argmax(improvement, axis=1)
        improves = improvement[lines, best] > noise
        if not np.any(improves):
            break
        signs[lines[improves], best[improves]] *= -1.0
    return np.unique(signs * signs[:, :1], axis=0)
