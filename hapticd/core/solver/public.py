"""Real modal amplitudes that give each finger its own vibration: w = Phi W, |w_i| = target, |W_k| <= limit (paper).

The rules are lexicographic. In this order: (1) |W_k| <= limit_k, always, to the last bit; (2) fingers with target 0 get
0; (3) the others' sum (|w_i| - a_i)^2 is least, their signs being free, because friction depends on |w_i| only; (4)
then sum |W_k|^2 is least; (5) of equals, the one nearest `previous_um`. At a singular position amplitudes therefore
stay where they are, where the inverse of Phi flips from limit to limit; at exactly coincident fingers W = 0. Two
fingers on two modes, one of them still, are solved in closed form (`hold_still`), all else by descent (`felt_descent`)
from several patterns of signs: as far as that goes. With `gram` fingers are contacts, under another rule (`instant`).
"""

from __future__ import annotations

import itertools
import math
import sys
from array import array

import numpy as np
import numpy.typing as npt

from ...values import FloatArray, Solution
from ..friction import DEFAULT_FRICTION_CURVE as CURVE
from .felt_descent import descend
from .instant import SAFE, clamped, finger_table, hold_still

OF_POINTS, OF_CONTACTS = 4000, 84  # iterations of a descent, from anywhere
MOST_PATTERNS = 16  # of signs
EQUAL_ERROR, EQUAL_NORM = 1e-9, 1e-6  # of squares: solutions that differ by less are equals
MISSED = 1e-6  # of a target: a finger that lacks more than this does not get it
MOST_REACH = 1e3  # a target so many times out of reach acts like any farther one
FAR = 1e12  # times what is asked for: amplitudes beyond act like it
NOISE = 1e-12  # of an even pattern's amplitudes
MOST_MODES = 8  # of a descent


@np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore")
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
    gram (N, M, M) or None: the mean of phi_k phi_l over each finger's contact; `achieved_um` is then its RMS.
    Raises ValueError, in one sentence, for wrong shapes, numbers that are not finite, negative targets, limits that are
    not positive.
    """
    shapes, targets, limits, previous = _checked_all(phi, target_um, limit_um, previous_um)
    condition = float(np.linalg.cond(shapes)) if shapes.size else 1.0
    if gram is not None and targets.any():
        grams = _checked("gram", gram, (*shapes.shape, shapes.shape[1]))
        return Solution(*_solved_contacts(grams, targets, limits, previous), condition)
    modal, limited = _solved_points(shapes, targets, limits, previous)
    sizes = np.maximum(np.abs(shapes).max(axis=1, initial=0.0), sys.float_info.min)
    achieved = np.minimum(np.abs(shapes / sizes[:, None] @ modal) * sizes, sys.float_info.max)
    return Solution(modal, achieved, limited, condition)


def solve_batch(
    phi: npt.ArrayLike, target_um: npt.ArrayLike, limit_um: npt.ArrayLike, *, previous_um: npt.ArrayLike | None = None
) -> FloatArray:
    """Modal amplitudes (K, M) for K instants in order; each is the next one's `previous_um`.

    phi (K, N, M); target_um (N,) for all instants; the rest as in `solve`.
    """
    track, targets, limits, previous = _checked_all(phi, target_um, limit_um, previous_um, axes=3)
    modal_um = []
    for shapes in track:
        previous, _ = _solved_points(shapes, targets, limits, previous)
        modal_um.append(previous)
    return np.array(modal_um).reshape(len(track), len(limits))


@np.errstate(over="ignore", under="ignore", invalid="ignore")
def _solved_points(
    shapes: FloatArray, targets: FloatArray, limits: FloatArray, near: FloatArray
) -> tuple[FloatArray, bool]:
    modes, slips = len(limits), targets > 0.0
    if len(shapes) == 2 == modes and slips.sum() == 1 and shapes[~slips].any():
        (row,), (still,), (x_um, y_um) = shapes[slips].tolist(), shapes[~slips].tolist(), limits.tolist()
        before = complex(clamped(near[0], SAFE)), complex(clamped(near[1], SAFE))
        pair, _, limited = hold_still(tuple(row), float(targets.max()), tuple(still), (x_um, y_um), before)
        return np.array(pair), limited
    size = float(np.abs(shapes[slips]).max(initial=0.0))
    if size == 0.0:
        return np.zeros(modes), False
    # In units in which the largest amplitude that is asked for and within reach is 1.
    top, largest = float(limits.max()), np.abs(shapes).max(axis=1, keepdims=True)
    rows = shapes / np.where(slips[:, None], size, np.where(largest > 0.0, largest, 1.0))
    reach = np.maximum(np.abs(rows[slips]) @ (limits / top), sys.float_info.min)
    unit = max(float(np.max(np.minimum(targets[slips] / size / top, reach))), sys.float_info.min)
    asked = np.minimum(targets / size / top / unit, SAFE)
    most = 1.0 if slips.sum() == 1 else MOST_REACH
    requested = np.where(slips, np.clip(asked, 1.0 / SAFE, most), 0.0)  # where it underflows
    box = np.clip(limits / top / unit, 1.0 / FAR, FAR)
    near = np.clip(near / top, -unit * FAR, unit * FAR) / unit
    fingers = array("d", [*requested, *[1.0] * (7 * len(requested))])
    starts = _starts(rows, requested, near)
    settled = [_descended(rows[:, None], fingers, box, start, OF_POINTS) for start in starts]
    found = np.nan_to_num(settled)  # where the curvature of tiny shapes underflows
    errors = np.sum((np.abs(found @ rows.T) - requested) ** 2, axis=1)
    best = found[errors <= errors.min() + EQUAL_ERROR * requested @ requested]
    norms = np.sum(best**2, axis=1)
    best = best[norms <= norms.min() * (1.0 + EQUAL_NORM)]
    best *= np.copysign(1.0, best @ near)[:, None]  # alike for every finger
    modal = best[np.argmin(np.sum((best - near) ** 2, axis=1))]
    limited = _is_limited(modal, np.abs(rows @ modal), asked, box)
    return np.array([clamped(w, limit) for w, limit in zip(modal * unit * top, limits, strict=True)]), limited


def _starts(rows: FloatArray, requested: FloatArray, near: FloatArray) -> list[FloatArray]:
    """Return the present amplitudes, if there are any, those that serve each slipping finger alone, and those that are
    best within no limits, for patterns of signs."""
    slips = np.flatnonzero(requested)
    inverse, patterns = np.linalg.pinv(rows)[:, slips], itertools.product((1.0, -1.0), repeat=len(slips))
    different = itertools.islice(patterns, min(2 ** len(slips) // 2, MOST_PATTERNS))
    starts = [
        near,
        *rows[slips] * requested[slips, None],
        *[inverse @ (signs * requested[slips]) for signs in different],
    ]
    return [np.clip(start, -SAFE, SAFE) for start in starts if start.any()]


def _descended(
    shapes: FloatArray, fingers: array[float], limits: FloatArray, start: FloatArray, iterations: int
) -> FloatArray:
    """Return the real amplitudes, within the limits, where the descent from a start settles, for the shapes (N, Q, M)
    at the points of contacts; a real start stays real."""
    weights = np.full(shapes.shape[1], 1.0 / shapes.shape[1])
    given = shapes.tobytes(), weights, fingers, CURVE.table, limits, tuple(map(complex, start))
    ((modal_um, _),) = descend(*given, iterations, (math.inf,))
    return np.real(modal_um)


def _is_limited(modal: FloatArray, got: FloatArray, targets: FloatArray, limits: FloatArray) -> bool:
    is_missed = np.abs(got - targets) > MISSED * targets
    return bool(is_missed[targets > 0.0].any() and (np.abs(modal) >= (1.0 - MISSED) * limits).any())


def _solved_contacts(
    grams: FloatArray, targets: FloatArray, limits: FloatArray, near: FloatArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Solve for contacts, from the amplitudes in which slipping ones differ most from the others. A Gram matrix is that
    of M points: its eigenvectors, mixed by a cosine transform, so that an even vibration is even at the points too."""
    fingers, modes = grams.shape[:2]
    sizes, vectors = np.linalg.eigh(grams)
    mixed = np.cos(np.pi / modes * np.outer(np.arange(modes) + 0.5, np.arange(modes)[::-1])) * math.sqrt(2.0)
    mixed[:, -1] = 1.0  # of the largest one, the last
    shapes, slips = np.einsum("qj,nj,nkj->nqk", mixed, np.sqrt(np.maximum(sizes, 0.0)), vectors), targets > 0.0
    _, contrasts = np.linalg.eigh(grams[slips].sum(axis=0) - grams[~slips].sum(axis=0))
    starts = [near, *[contrast * np.min(limits / np.maximum(np.abs(contrast), NOISE)) for contrast in contrasts.T]]
    table = finger_table(CURVE, targets.tolist(), [0.0] * fingers, [1.0] * fingers, [0] * fingers)
    found = np.array([_descended(shapes, table[:], limits, start, OF_CONTACTS) for start in starts if start.any()])
    got = np.sqrt(np.maximum(np.einsum("sk,nkl,sl->sn", found, grams, found), 0.0))
    best = np.argmin(np.abs(got - targets).max(axis=1))
    return found[best], got[best], _is_limited(found[best], got[best], targets, limits)


def _checked_all(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    previous_um: npt.ArrayLike | None,
    axes: int = 2,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    shapes = _checked("phi", phi, (None,) * axes)
    fingers, modes = shapes.shape[-2:]
    if not 1 <= modes <= MOST_MODES:
        raise ValueError(f"phi: has {modes} modes on its last axis, which must hold 1 .. {MOST_MODES}.")
    targets = _checked("target_um", target_um, (fingers,))
    if (targets < 0.0).any():
        raise ValueError("target_um: amplitudes must be 0 or more; the solver chooses the sign.")
    limits = _checked("limit_um", [limit_um] * modes if isinstance(limit_um, (float, int)) else limit_um, (modes,))
    if not (limits > 0.0).all():
        raise ValueError("limit_um: every limit must be greater than 0.")
    previous = [0.0] * modes if previous_um is None else previous_um
    return shapes, targets, limits, _checked("previous_um", previous, (modes,))


def _checked(name: str, values: npt.ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: must be an array of numbers, all rows of the same length.") from None
    if array.ndim != len(shape) or any(map(lambda asked, found: asked not in (None, found), shape, array.shape)):
        raise ValueError(f"{name}: has shape {array.shape}, which does not fit phi; see the arrays' shapes in `solve`.")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")
    return array
