"""The solver for three modes and more: null space, sign patterns, least squares within the limits.

The still fingers leave a subspace of modal amplitudes, W = basis z (singular value decomposition; rows are scaled to
a largest entry of 1, ranks are cut at `RANK`). For every sign pattern of the slipping fingers the minimum-norm
least-squares z is tried first; only where it leaves the box |W_k| <= limit_k does the active set of
`core.solver.polytope` run, and only if the pattern can still win.

Cost, n slipping fingers, r dimensions left: the exact minimum over n patterns for r = 2, n^2 / 2 for r = 3, 2^(n-1)
for r > 3 up to n = 7; beyond that a local search over single signs from n + r starts. A pattern costs O(n r), and
where limits bind some 2 M decompositions of O(n r^2) each.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .arithmetic import NOISE, Row, normalised
from .box import sign_patterns
from .candidates import EQUAL_ERROR, Candidate, choose, excess_error, misses, square
from .polytope import RANK, Factored, least_norm_in_polytope

FloatArray = npt.NDArray[np.float64]

_MOST_ENUMERATED = 7  # slipping fingers: 64 patterns
_SAME_RAY = 1e-9  # angle below which planes count as passing through one ray; extra patterns do no harm


class Space(NamedTuple):
    """What the still fingers leave: W = basis z within +-box, and what each slipping finger gets of z."""

    basis: FloatArray  # (M, r), orthonormal
    gains: FloatArray  # (n, r)
    box: FloatArray  # (M,)
    effort: float


class Scaled(NamedTuple):
    """A problem brought to a largest gain and limit of 1; W is to be multiplied by `reach`."""

    space: Space
    wanted: list[float]
    reach: float


class Attempt(NamedTuple):
    """A sign pattern that does not fit the box, and what it would do without limits: a bound on what it can do."""

    signs: Row
    bound: Candidate  # amplitudes signed: positive where they have the pattern's sign


def solve_space(
    still: Sequence[Row],
    slipping: Sequence[Row],
    targets: Sequence[float],
    limits: Row,
    previous: Row | None,
    effort: float = 0.0,
    hysteresis: float = 0.0,
) -> tuple[Row, bool]:
    """`keep_zero` for any number of modes: modal amplitudes, and whether a limit keeps a finger from its target."""
    problem = _scaled(still, slipping, targets, limits, effort)
    if problem is None:
        return (0.0,) * len(limits), False
    near = None if previous is None else tuple([w / problem.reach for w in previous])
    candidates = _candidates(problem.space, problem.wanted, near, hysteresis)
    chosen = choose(candidates, problem.wanted, near, problem.space.effort, hysteresis)
    limited = chosen.clamped and misses(chosen.amplitudes, problem.wanted)
    return _unscaled(chosen.modal, problem.reach, limits), limited


def solve_pattern(
    still: Sequence[Row], slipping: Sequence[Row], targets: Sequence[float], signs: Sequence[float], limits: Row
) -> Row:
    """As `solve_space`, with the slipping fingers' signs given."""
    problem = _scaled(still, slipping, targets, limits, 0.0)
    if problem is None:
        return (0.0,) * len(limits)
    basis, gains, box, _ = problem.space
    factored = Factored.of(gains, 0.0)
    wanted = np.array(signs) * np.array(problem.wanted)
    z = factored.least_norm(wanted)
    if not np.all(np.abs(basis @ z) <= box):
        z = least_norm_in_polytope(factored, wanted, basis, box)
    return _unscaled((basis @ z).tolist(), problem.reach, limits)


def _scaled(
    still: Sequence[Row], slipping: Sequence[Row], targets: Sequence[float], limits: Row, effort: float
) -> Scaled | None:
    """The problem at a largest gain and limit of 1; None where nothing can move a slipping finger."""
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
    size = max(size * largest, sys.float_info.min)
    wanted, box, effort, reach = normalised(size, targets, limits, effort)
    return Scaled(Space(basis, gains / largest, np.array(box), effort), wanted, reach)


def _unscaled(modal: Sequence[float], reach: float, limits: Row) -> Row:
    return tuple([max(-limit, min(limit, w * reach)) for w, limit in zip(modal, limits, strict=True)])


def null_basis(still: Sequence[Row], modes: int) -> FloatArray:
    """Orthonormal columns (M, r) of the modal amplitudes that move no still finger."""
    sizes = [max([abs(value) for value in row]) for row in still]
    rows = [[value / size for value in row] for row, size in zip(still, sizes, strict=True) if size > 0.0]
    if not rows:
        return np.eye(modes)
    _, singular, right = np.linalg.svd(np.array(rows))
    rank = int(np.count_nonzero(singular > RANK * singular[0]))
    return np.ascontiguousarray(right[rank:].T)


# --- sign patterns ------------------------------------------------------------------------------------------------


def _candidates(space: Space, targets: Sequence[float], previous: Row | None, hysteresis: float) -> list[Candidate]:
    factored = Factored.of(space.gains, space.effort)
    solver = _PatternSolver(space, factored, targets, hysteresis if previous is not None else 0.0)
    moved = np.flatnonzero(np.any(space.gains != 0.0, axis=1))
    patterns = _patterns(space.gains[moved])
    if patterns is not None:
        solver.solve(_spread(patterns, moved, len(targets)))
        return solver.candidates
    start = None if previous is None else np.array(previous) @ space.basis
    kernel = factored.fitted(len(targets))[np.ix_(moved, moved)] * np.outer(*[np.array(targets)[moved]] * 2)
    optima = _locally_best(kernel, space.gains[moved], start)
    solver.solve(_spread(optima, moved, len(targets)))
    around: Row = ()
    while solver.best_signs != around:
        around = solver.best_signs
        flips = np.where(np.eye(len(targets), dtype=bool)[moved], -1.0, 1.0) * np.array(around)
        solver.solve([tuple(signs) for signs in flips.tolist()])
    return solver.candidates


def _patterns(gains: FloatArray) -> FloatArray | None:
    """All signs (count, n) that n fingers' amplitudes can have, up to a common one; None where these are too many."""
    fingers, dimensions = gains.shape
    if dimensions == 1:
        return np.sign(gains).T
    if dimensions == 2:
        return np.array(sign_patterns([tuple(row) for row in gains.tolist()]))
    if fingers <= _MOST_ENUMERATED:
        return np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=fingers - 1)])
    if dimensions > 3:
        return None
    return _cells_in_space(gains)


def _cells_in_space(gains: FloatArray) -> FloatArray:
    """The sign patterns in three dimensions: every cell between the planes where a finger is still has a corner ray
    on two of them, and around the ray the fingers whose planes hold it see a problem in the plane."""
    unit = gains / np.linalg.norm(gains, axis=1, keepdims=True)
    found: set[Row] = set()
    for first, second in combinations(range(len(unit)), 2):
        ray = np.cross(unit[first], unit[second])
        length = float(np.linalg.norm(ray))
        if length <= _SAME_RAY:
            continue
        ray /= length
        level = unit @ ray
        around = np.flatnonzero(np.abs(level) <= _SAME_RAY)
        across = np.column_stack([unit[around] @ unit[first], unit[around] @ np.cross(ray, unit[first])])
        signs = np.where(level >= 0.0, 1.0, -1.0)
        for pattern in sign_patterns([tuple(row) for row in across.tolist()]):
            for turn in (1.0, -1.0):
                signs[around] = turn * np.array(pattern)
                found.add(tuple((signs * signs[0]).tolist()))
    return np.array(sorted(found))


def _locally_best(kernel: FloatArray, gains: FloatArray, previous: FloatArray | None) -> FloatArray:
    """Signs that no single change improves, limits aside: s' kernel s is what of the targets' squares they serve.

    From every principal direction, every finger's own, and the plate's present one.
    """
    directions = [*np.linalg.svd(gains, full_matrices=False)[2], *gains]
    if previous is not None:
        directions.append(previous)
    signs = np.where(np.array(directions) @ gains.T >= 0.0, 1.0, -1.0)
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


def _spread(patterns: FloatArray, moved: npt.NDArray[np.intp], fingers: int) -> list[Row]:
    """Signs of all fingers from those of the ones that can be moved."""
    full = np.ones((len(patterns), fingers))
    full[:, moved] = patterns
    return [tuple(signs) for signs in full.tolist()]


class _PatternSolver:
    """Solves sign patterns and keeps the candidates; a pattern whose lower bound has lost is not worked out."""

    def __init__(self, space: Space, factored: Factored, targets: Sequence[float], width: float) -> None:
        self.space = space
        self.candidates: list[Candidate] = []
        self.best_signs: Row = ()
        self._best: Candidate | None = None
        self._factored = factored
        self._targets = targets
        self._width = max(EQUAL_ERROR, width)

    def solve(self, patterns: Sequence[Row]) -> None:
        """Take these patterns: first those that fit the box as they are, then what may still beat them."""
        wanted = np.array(patterns) * np.array(self._targets)
        free = self._factored.least_norm(wanted.T).T
        modal = free @ self.space.basis.T
        fits = np.all(np.abs(modal) <= self.space.box, axis=1).tolist()
        bent: list[Attempt] = []
        for signs, z, w, fit in zip(patterns, free, modal.tolist(), fits, strict=True):
            given = self.space.gains @ z
            if fit:
                self._keep(signs, Candidate(tuple(w), tuple(np.abs(given).tolist()), False))
            else:
                bent.append(Attempt(signs, Candidate(tuple(w), tuple((np.array(signs) * given).tolist()), True)))
        for attempt in bent:
            if not self._has_lost(attempt.bound):
                self._keep(attempt.signs, self._bend(attempt))

    def _bend(self, attempt: Attempt) -> Candidate:
        wanted = np.array(attempt.signs) * np.array(self._targets)
        z = least_norm_in_polytope(self._factored, wanted, self.space.basis, self.space.box)
        modal, given = self.space.basis @ z, np.abs(self.space.gains @ z)
        return Candidate(tuple(modal.tolist()), tuple(given.tolist()), True)

    def _has_lost(self, bound: Candidate) -> bool:
        best = self._best
        if best is None:
            return False
        excess = excess_error(bound, best, self._targets, self.space.effort)
        scale = sum([a * v for a, v in zip(self._targets, best.amplitudes, strict=True)])
        if excess > self._width * scale:
            return True
        return excess >= 0.0 and square(bound.modal) > square(best.modal) * (1.0 + 2.0 * self._width + 1e-6)

    def _keep(self, signs: Row, one: Candidate) -> None:
        self.candidates.append(one)
        best = self._best
        if best is None or excess_error(one, best, self._targets, self.space.effort) < 0.0:
            self._best, self.best_signs = one, signs
