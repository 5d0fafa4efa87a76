"""Modal amplitudes that give each finger its own vibration: w = Phi W, |w_i| = target, |W_k| <= limit (paper, eq. 1-3).

The rules (`keep_zero`) are lexicographic. In this order: (1) |W_k| <= limit_k, always, to the last bit; (2) fingers
with target 0 get 0; (3) the others' sum (|w_i| - a_i)^2 is least, their signs being free, because friction depends on
|w_i| only; (4) then sum |W_k|^2 is least; (5) of equals, the one nearest `previous_um`. At a singular position
amplitudes therefore stay where they are, where the inverse of Phi flips from limit to limit; at exactly coincident
fingers W = 0.

With `gram` fingers are contacts, under another rule (`felt`).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ...values import FloatArray, Solution
from ..friction import DEFAULT_FRICTION_CURVE
from ..phasors import ModeRow, ModeRows, amplitudes, clamped
from .checks import (
    checked_grams,
    checked_limits,
    checked_previous,
    checked_shapes,
    checked_target_track,
    checked_targets,
    checked_track,
)
from .felt import solve_felt
from .points.general import condition, solve_exactly

_SIZELESS = 1e-12  # a contact of no size is a point
SETTLING_CALLS = 12  # of a contact's descent, from anywhere
LEAST_SHARE = 1e-4  # of the mean curvature, by which that of still contacts is definite

__all__ = ["solve", "solve_batch"]


def solve(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    previous_um: npt.ArrayLike | None = None,
    gram: npt.ArrayLike | None = None,
) -> Solution:
    """Modal amplitudes for one instant.

    phi (N, M): mode shapes at the fingers; target_um (N,); limit_um (M,) or one number; previous_um (M,) or None;
    gram (N, M, M) or None: the mean of phi_k phi_l over each finger's contact (`plate.contact_grams`); `achieved_um` is
    then the RMS over each contact.
    Raises ValueError, in one sentence, for wrong shapes, numbers that are not finite, negative targets, limits that are
    not positive.
    """
    rows, modes = checked_shapes(phi)
    targets = checked_targets(target_um, len(rows))
    limits, previous = checked_limits(limit_um, modes), checked_previous(previous_um, modes)
    if gram is not None:
        grams = checked_grams(gram, (len(rows), modes, modes))
        if not np.allclose(grams, [np.outer(row, row) for row in rows], rtol=_SIZELESS, atol=0.0):
            return _solved_contacts(grams, rows, targets, limits, previous)
    modal, limited = solve_exactly(rows, targets, limits, previous)
    return Solution(np.array(modal), np.array(amplitudes(rows, modal)), limited, _condition(rows))


def solve_batch(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    previous_um: npt.ArrayLike | None = None,
) -> FloatArray:
    """Modal amplitudes (K, M) for K instants in order; each is the next one's `previous_um`.

    phi (K, N, M); target_um (K, N), or (N,) for all instants; the rest as in `solve`.
    """
    track = checked_track(phi)
    count, fingers, modes = track.shape
    targets = checked_target_track(target_um, count, fingers)
    limits, previous = checked_limits(limit_um, modes), checked_previous(previous_um, modes)
    modal_um: list[ModeRow] = []
    for shapes, wanted in zip(track.tolist(), targets.tolist(), strict=True):
        rows: ModeRows = tuple(map(tuple, shapes))
        previous, _ = solve_exactly(rows, tuple(wanted), limits, previous)
        modal_um.append(previous)
    return np.array(modal_um).reshape(count, modes)


def _solved_contacts(
    grams: FloatArray, rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None
) -> Solution:
    """Solve for contacts with real amplitudes: a real start stays real. A Gram matrix is that of M points:
    its eigenvectors, mixed by a cosine transform, so that an even vibration is even at the points too."""
    modes = len(limits)
    sizes, vectors = np.linalg.eigh(grams)
    mixed = np.cos(np.pi / modes * np.outer(np.arange(modes) + 0.5, np.arange(modes)[::-1])) * math.sqrt(2.0)
    mixed[:, -1] = 1.0  # of the largest one, the last
    shapes = np.einsum("qj,nj,nkj->nqk", mixed, np.sqrt(np.maximum(sizes, 0.0)), vectors).tobytes()
    starts = [] if previous is None or not any(previous) else [list(previous)]
    least, best, achieved, limited = math.inf, [0.0] * modes, [0.0] * len(rows), False
    for modal in [*starts, *_contrasts(grams, targets, limits)]:
        none, weights = [0.0] * modes, [1.0 / modes] * modes
        logs, slides, ranks = [0.0] * len(rows), [1.0] * len(rows), [0] * len(rows)
        for _ in range(SETTLING_CALLS):
            got, is_limited = solve_felt(
                shapes, weights, DEFAULT_FRICTION_CURVE, targets, limits, modal, none, logs, slides, ranks
            )
        missed = max([abs(one - target) for one, target in zip(got, targets, strict=True)])
        if missed < least:
            least, best, achieved, limited = missed, modal, got, is_limited
    modal = [clamped(w, limit) for w, limit in zip(best, limits, strict=True)]
    return Solution(np.array(modal), np.array(achieved), limited, _condition(rows))


def _contrasts(grams: FloatArray, targets: ModeRow, limits: ModeRow) -> list[list[float]]:
    """Return the amplitudes from which to start: those in which slipping contacts differ most from the others."""
    modes, slips = len(limits), np.array(targets) > 0.0
    still = grams[~slips].sum(axis=0) + LEAST_SHARE * np.trace(grams.sum(axis=0)) / modes * np.eye(modes)
    try:
        lower = np.linalg.inv(np.linalg.cholesky(still))
    except np.linalg.LinAlgError:  # shapes that are all 0, or whose squares leave the range of floats
        return [list(limits)]
    _, vectors = np.linalg.eigh(lower @ grams[slips].sum(axis=0) @ lower.T)
    found = lower.T @ vectors
    found *= np.min(np.array(limits)[:, None] / np.maximum(np.abs(found), np.finfo(float).tiny), axis=0)
    return [list(map(float, one)) for one in found.T[::-1]]


def _condition(rows: ModeRows) -> float:
    if len(rows) == 2 == len(rows[0]):
        (a, b), (c, d) = rows
        return condition((a, b, c, d))
    if not rows:
        return 1.0
    matrix = np.array(rows)
    size = float(np.max(np.abs(matrix)))
    if size == 0.0:
        return math.inf
    singular = np.linalg.svd(matrix / size, compute_uv=False)
    largest, smallest = float(singular[0]), float(singular[-1])
    return largest / smallest if smallest > 0.0 else math.inf
