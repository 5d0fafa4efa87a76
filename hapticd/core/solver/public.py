"""Modal amplitudes that give each finger its own vibration: w = Phi W, |w_i| = target, |W_k| <= limit (paper, eq. 1-3).

The rules (`keep_zero`) are lexicographic. In this order: (1) |W_k| <= limit_k, always, to the last bit; (2) fingers
with target 0 get 0; (3) the others' sum (|w_i| - a_i)^2 is least, their signs being free, because friction depends on
|w_i| only; (4) then sum |W_k|^2 is least; (5) of equals, the one nearest `previous_um`. At a singular position
amplitudes therefore stay where they are, where the inverse of Phi flips from limit to limit; at exactly coincident
fingers W = 0.

With `gram` fingers are contacts, under other rules (`contacts`).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ...values import FloatArray, Solution
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
from .contacts import COLD_TURN_RAD, solve_contacts
from .points.general import condition, solve_exactly

_SIZELESS = 1e-12  # a contact of no size is a point
SETTLING_CALLS = 12  # of a contact's descent, from anywhere

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
    """Solve for contacts with real amplitudes: a real start stays real."""
    if previous is None or not any(previous):
        previous = tuple([limit * math.cos(COLD_TURN_RAD * k) for k, limit in enumerate(limits)])
    modal, none = list(map(float, previous)), [0.0] * len(limits)
    listed = grams.tolist()
    achieved, limited = solve_contacts(listed, targets, limits, modal, none)
    for _ in range(SETTLING_CALLS):
        achieved, limited = solve_contacts(listed, targets, limits, modal, none)
    modal = [clamped(w, limit) for w, limit in zip(modal, limits, strict=True)]
    return Solution(np.array(modal), np.array(achieved), limited, _condition(rows))


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
