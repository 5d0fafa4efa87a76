"""Friction as asked of fingers at random places on a plate: the daemon's own rule, from several starts.

`core.solver.instant` makes the largest error over contacts, in just noticeable differences, least. Fingers in motion
keep it near the best of many starts; fingers at random places have no past, so here it starts from several amplitudes,
and the best counts. Errors are those of the friction that the contacts have on the true shapes, by a finer rule of
points than the solver's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.plate.contact import SOLVED_DISC
from hapticd.core.solver.felt_descent import COLD, descend
from hapticd.core.solver.instant import ITERATIONS, finger_table
from hapticd.values import WEBER_FRAC, ComplexArray, FloatArray, OnProgress

from .contact_pairs import ShapeMaps, disc, random_fingers

FINE = (6, 20)  # radii and angles of the judgement: |w| has kinks, where contacts are crossed by nodal lines
STARTS = 4  # eight find 0 .. 2 % more places
ENOUGH_JND = 1.0
_AT_REST = np.zeros(1)
_BLOCK = 200  # places of a map that are solved at a time


@dataclass(frozen=True, slots=True)
class PlateTouches:
    """Shapes of M modes under N contacts at P places: `solved` (P, N, 12, M) at the solver's points and `true`
    (P, N, Q, M) at those of the judgement, whose `weights` (Q,) make the mean over a contact."""

    solved: FloatArray
    true: FloatArray
    weights: FloatArray

    def of(self, modes: Sequence[int], count: int | None = None) -> PlateTouches:
        """Return those of some modes, at the first `count` places."""
        return PlateTouches(self.solved[:count, :, :, modes], self.true[:count, :, :, modes], self.weights)

    def known_by(self, other: PlateTouches) -> PlateTouches:
        """Return the same places, solved on another's shapes."""
        return PlateTouches(other.solved, self.true, self.weights)


def touches(
    shapes: ShapeMaps, size_mm: tuple[float, float], radius_mm: float, fingers: int, count: int, seed: int
) -> PlateTouches:
    """Return the contacts of `fingers` at `count` random places. Raises ValueError for a plate without room."""
    return touches_at(shapes, random_fingers(size_mm, count, seed, fingers), radius_mm)


def touches_at(shapes: ShapeMaps, places_mm: FloatArray, radius_mm: float) -> PlateTouches:
    """Return the contacts of N fingers at each of P places, `places_mm` (P, N, 2)."""
    rule_mm = radius_mm * np.array([(dx, dy) for dx, dy, _ in SOLVED_DISC])
    offsets_mm, weights = disc(radius_mm, *FINE)

    def at(around_mm: FloatArray) -> FloatArray:
        points_mm = places_mm[:, :, None] + around_mm
        phi = shapes.evaluate(points_mm.reshape(-1, 2))
        return phi.reshape(*points_mm.shape[:-1], -1)

    return PlateTouches(at(rule_mm), at(offsets_mm), weights)


def settle_felt(
    found: PlateTouches,
    targets_um: Sequence[float],
    limits_um: npt.ArrayLike,
    starts: int = STARTS,
    curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
) -> tuple[ComplexArray, FloatArray]:
    """Return modal amplitudes (P, M) within the limits (M,), and each contact's error (P, N) in just noticeable
    differences: stickier is positive. Places where all are felt as asked are not started again."""
    limits = np.asarray(limits_um, np.float64)
    best_um = _descended(found.solved, targets_um, limits, np.zeros(limits.size, np.complex128), curve)
    best_jnd = errors_jnd(found, best_um, targets_um, curve)
    random = np.random.default_rng([1, limits.size])
    for _ in range(starts - 1):
        sizes, turns = random.uniform(0.3, 1.0, limits.size), random.uniform(0.0, 2.0 * np.pi, limits.size)
        left = np.flatnonzero(np.abs(best_jnd).max(axis=1) > ENOUGH_JND)
        if left.size == 0:
            break
        some = PlateTouches(found.solved[left], found.true[left], found.weights)
        tried_um = _descended(some.solved, targets_um, limits, limits * sizes * np.exp(1j * turns), curve)
        tried_jnd = errors_jnd(some, tried_um, targets_um, curve)
        is_better = np.abs(tried_jnd).max(axis=1) < np.abs(best_jnd[left]).max(axis=1)
        best_um[left[is_better]], best_jnd[left[is_better]] = tried_um[is_better], tried_jnd[is_better]
    return best_um, best_jnd


def errors_jnd(
    found: PlateTouches,
    modal_um: ComplexArray,
    targets_um: Sequence[float],
    curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
) -> FloatArray:
    """Return each contact's error (P, N) on the true shapes."""
    w_um = np.abs(np.einsum("pnqm,pm->pnq", found.true, modal_um, optimize=True))
    asked = np.array([curve.friction(target_um) for target_um in targets_um])
    return np.asarray((curve.frictions(w_um, _AT_REST) @ found.weights / asked - 1.0) / WEBER_FRAC)


def _descended(
    solved: FloatArray, targets_um: Sequence[float], limits_um: FloatArray, start_um: ComplexArray, curve: FrictionCurve
) -> ComplexArray:
    weights, alike = np.array(SOLVED_DISC)[:, 2].copy(), [1.0] * len(targets_um)
    iterations = COLD * ITERATIONS if start_um.any() else ITERATIONS
    limits, start, modal_um = np.ascontiguousarray(limits_um), tuple(start_um.tolist()), []
    for phi in solved:
        fingers = finger_table(curve, list(targets_um), [0.0] * len(alike), alike, [0] * len(alike))
        found = descend(phi.tobytes(), weights, fingers, curve.table, limits, start, iterations, (np.inf,))
        modal_um.append(found[0][0])
    return np.array(modal_um).reshape(len(solved), -1)


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
    """Return the map of cells x cells that tile the plate; `frictions` (N + 1,), 0 .. 1, are asked of the fingers, the
    other one last."""
    x_mm, y_mm = (edge_mm * ((np.arange(cells) + 0.5) / cells - 0.5) for edge_mm in size_mm)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    given_mm = np.broadcast_to(np.array(fingers_mm, np.float64), (len(points_mm), len(fingers_mm), 2))
    places_mm = np.concatenate((given_mm, points_mm[:, None, :]), axis=1)
    targets_um = [curve.amplitude_um(friction) for friction in frictions]
    blocks, solved = np.array_split(places_mm, math.ceil(len(places_mm) / _BLOCK)), []
    for done, block_mm in enumerate(blocks):
        progress(done / len(blocks))
        _, errors_jnd = settle_felt(touches_at(shapes, block_mm, radius_mm), targets_um, limits_um, curve=curve)
        solved.append(errors_jnd)
    return FeltMap(x_mm, y_mm, np.concatenate(solved).T.reshape(-1, cells, cells))
