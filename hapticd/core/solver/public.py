"""Modal amplitudes that give each finger its own vibration: w = Phi W, |w_i| = target, |W_k| <= limit (paper, eq. 1-3).

The rules are lexicographic. In this order: (1) |W_k| <= limit_k, always, to the last bit; (2) fingers with target 0 get
0; (3) the others' sum (|w_i| - a_i)^2 is least, their signs being free, because friction depends on |w_i| only; (4)
then sum |W_k|^2 is least; (5) of equals, the one nearest `previous_um`. At a singular position amplitudes therefore
stay where they are, where the inverse of Phi flips from limit to limit; at exactly coincident fingers W = 0. Two
fingers on two modes, one of them still, are solved in closed form (`two_modes`), all else by descent (`felt_descent`)
from several patterns of signs: as far as that goes.

With `gram` fingers are contacts, under another rule (`felt`).
"""

from __future__ import annotations

import itertools
import math
import sys
from array import array
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from ...values import FloatArray, Solution
from ..friction import DEFAULT_FRICTION_CURVE
from .felt import solve_felt
from .felt_descent import descend
from .instant import POINT
from .two_modes import SAFE, clamped, hold_still

MOST_ENUMERATED = 5  # slipping fingers, whose patterns of signs are all tried
ROUNDS, ITERATIONS, STILL_ITERATIONS = 20, 30, 200  # of a descent of points, and where some are still
SETTLED = 1e-12  # of the largest amplitude that is asked for: less changes nothing
STAY_FRAC = 1e-3
EQUAL_ERROR = 1e-9  # of the targets' squares: solutions that differ by less are equals
EQUAL_NORM = 1e-6
MISSED = 1e-6  # of a target: a finger that lacks more than this does not get it
MOST_REACH = 1e3  # a target so many times out of reach acts like any farther one
FAR = 1e12  # times what is asked for: amplitudes beyond act like it
NOISE = 1e-12  # of the largest shape
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
    shapes = _checked("phi", phi, (None, None))
    fingers, modes = shapes.shape
    targets, limits, previous = _checked_rest(fingers, modes, target_um, limit_um, previous_um)
    if gram is not None:
        grams = _checked("gram", gram, (fingers, modes, modes))
        if not np.allclose(grams, shapes[:, :, None] * shapes[:, None, :], rtol=NOISE, atol=0.0):
            modal, achieved, limited = _solved_contacts(grams, targets, limits, previous)
            return Solution(modal, achieved, limited, _condition(shapes))
    modal, limited = _solved_points(shapes, targets, limits, previous)
    return Solution(modal, _achieved(shapes, modal), limited, _condition(shapes))


def solve_batch(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    previous_um: npt.ArrayLike | None = None,
) -> FloatArray:
    """Modal amplitudes (K, M) for K instants in order; each is the next one's `previous_um`.

    phi (K, N, M); target_um (N,) for all instants; the rest as in `solve`.
    """
    track = _checked("phi", phi, (None, None, None))
    _, fingers, modes = track.shape
    targets, limits, previous = _checked_rest(fingers, modes, target_um, limit_um, previous_um)
    modal_um = []
    for shapes in track:
        previous, _ = _solved_points(shapes, targets, limits, previous)
        modal_um.append(previous)
    return np.array(modal_um).reshape(len(track), modes)


# --- points ---------------------------------------------------------------------------------------------------------


@np.errstate(over="ignore", under="ignore", invalid="ignore")
def _solved_points(
    shapes: FloatArray, targets: FloatArray, limits: FloatArray, previous: FloatArray | None
) -> tuple[FloatArray, bool]:
    fingers, modes = shapes.shape
    slips = targets > 0.0
    near = np.zeros(modes) if previous is None else previous
    if fingers == 2 == modes and slips.sum() == 1 and shapes[~slips].any():
        (row,), (still,), (x_um, y_um) = shapes[slips].tolist(), shapes[~slips].tolist(), limits.tolist()
        before = complex(clamped(near[0], SAFE)), complex(clamped(near[1], SAFE))
        pair, _, limited = hold_still(tuple(row), float(targets.max()), tuple(still), (x_um, y_um), before)
        return np.array(pair), limited
    size = float(np.abs(shapes[slips]).max(initial=0.0))
    if size == 0.0:
        return np.zeros(modes), False
    # In units in which the largest amplitude that is asked for and within reach is 1.
    rows = np.array(
        [row / (np.abs(row).max() or 1.0) if not slip else row / size for row, slip in zip(shapes, slips, strict=True)]
    )
    reach, top = np.abs(rows[slips]) @ (limits / limits.max()), float(limits.max())
    unit = float(np.max(np.minimum(targets[slips] / size / top, np.maximum(reach, sys.float_info.min))))
    unit = max(unit, sys.float_info.min)
    asked = np.minimum(targets / size / top / unit, SAFE)
    wanted = np.minimum(asked, 1.0 if slips.sum() == 1 else MOST_REACH)
    wanted[slips] = np.maximum(wanted[slips], 1.0 / SAFE)  # where it underflows
    wanted[~slips] = 0.0
    box = np.clip(limits / top / unit, 1.0 / FAR, FAR)
    near, equal = np.clip(near / top, -unit * FAR, unit * FAR) / unit, EQUAL_ERROR * float(wanted @ wanted)
    found = [_descended(rows, wanted, box, start) for start in _starts(rows, wanted, near)]
    errors = np.array([float(np.sum((np.abs(rows @ modal) - wanted) ** 2)) for modal in found])
    found = [modal for modal, error in zip(found, errors, strict=True) if error <= errors.min() + equal]
    least = min([float(modal @ modal) for modal in found])
    found = [modal if near @ modal >= 0.0 else -modal for modal in found if modal @ modal <= least * (1.0 + EQUAL_NORM)]
    best = min(found, key=lambda modal: float(np.sum((modal - near) ** 2)))  # W and -W are equal for every finger
    is_missed = bool(np.any(np.abs(np.abs(rows @ best) - asked)[slips] > MISSED * asked[slips]))
    limited = is_missed and bool(np.any(np.abs(best) >= (1.0 - MISSED) * box))
    return np.array([clamped(w, limit) for w, limit in zip(best * unit * top, limits, strict=True)]), limited


def _starts(rows: FloatArray, wanted: FloatArray, near: FloatArray) -> Iterable[FloatArray]:
    """Return the present amplitudes, if there are any, those that serve each slipping finger alone, and those that are
    best within no limits, for every pattern of signs of few slipping fingers, and for some of many."""
    slips = np.flatnonzero(wanted > 0.0)
    if near.any():
        yield near
    inverse, count = np.linalg.pinv(rows), len(slips)
    yield from rows[slips] * wanted[slips, None] if count > 1 else ()
    patterns: Iterable[tuple[float, ...]] = itertools.product((1.0, -1.0), repeat=count - 1)
    if count > MOST_ENUMERATED:
        patterns = [tuple(row) for row in np.random.default_rng(count).choice((1.0, -1.0), (16, count - 1))]
    for signs in patterns:
        signed = wanted.copy()
        signed[slips[1:]] *= signs
        yield inverse @ signed


def _descended(rows: FloatArray, wanted: FloatArray, box: FloatArray, start: FloatArray) -> FloatArray:
    """Return the real amplitudes, within the box, where the descent from a start settles."""
    most, fingers, shapes = np.abs(start).max(), array("d", [*wanted, *[1.0] * (7 * len(wanted))]), rows.tobytes()
    modal = tuple(map(complex, start / most * min(most, SAFE) if most > 0.0 else box))
    iterations, curve = ITERATIONS if wanted.all() else STILL_ITERATIONS, DEFAULT_FRICTION_CURVE.table
    for _ in range(ROUNDS):
        before = modal
        modal, _ = descend(shapes, np.array(POINT), fingers, curve, box, modal, iterations, STAY_FRAC, math.inf)
        if np.abs(np.subtract(modal, before)).max() <= SETTLED:
            break
    return np.real(modal)


# --- contacts, by their Gram matrices -------------------------------------------------------------------------------


def _solved_contacts(
    grams: FloatArray, targets: FloatArray, limits: FloatArray, previous: FloatArray | None
) -> tuple[FloatArray, FloatArray, bool]:
    """Solve for contacts with real amplitudes: a real start stays real, as are those in which slipping contacts differ
    most from the others. A Gram matrix is that of M points: its eigenvectors, mixed by a cosine transform, so that an
    even vibration is even at the points too."""
    fingers, modes = len(grams), len(limits)
    sizes, vectors = np.linalg.eigh(grams)
    mixed = np.cos(np.pi / modes * np.outer(np.arange(modes) + 0.5, np.arange(modes)[::-1])) * math.sqrt(2.0)
    mixed[:, -1] = 1.0  # of the largest one, the last
    shapes = np.einsum("qj,nj,nkj->nqk", mixed, np.sqrt(np.maximum(sizes, 0.0)), vectors).tobytes()
    disc, slips = np.array([(*POINT[0][:2], 1.0 / modes)] * modes), targets > 0.0
    _, contrasts = np.linalg.eigh(grams[slips].sum(axis=0) - grams[~slips].sum(axis=0))
    starts = [contrast * np.min(limits / np.maximum(np.abs(contrast), NOISE)) for contrast in contrasts.T]
    found = []
    for start in [*([] if previous is None or not previous.any() else [previous]), *starts]:
        modal, logs = tuple(map(complex, start)), [0.0] * fingers
        given = [1.0] * fingers, [0] * fingers
        for _ in range(SETTLING_CALLS):
            modal, got, limited = solve_felt(
                shapes, disc, DEFAULT_FRICTION_CURVE, targets.tolist(), limits, modal, logs, *given
            )
        within = [clamped(w, limit) for w, limit in zip(np.real(modal).tolist(), limits.tolist(), strict=True)]
        found.append((float(np.abs(np.array(got) - targets).max()), within, got, limited))
    _, within, got, limited = min(found)
    return np.array(within), np.array(got), limited


# --- figures and checks ---------------------------------------------------------------------------------------------


def _achieved(shapes: FloatArray, modal: FloatArray) -> FloatArray:
    sizes = np.abs(shapes).max(axis=1, initial=0.0)
    sizes[sizes == 0.0] = 1.0
    with np.errstate(over="ignore"):
        return np.asarray(np.minimum(np.abs(shapes / sizes[:, None] @ modal) * sizes, sys.float_info.max))


@np.errstate(over="ignore")
def _condition(shapes: FloatArray) -> float:
    """The largest singular value over the smallest."""
    if len(shapes) == 0:
        return 1.0
    size = float(np.abs(shapes).max())
    if size == 0.0:
        return math.inf
    singular = np.linalg.svd(shapes / size, compute_uv=False)
    return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else math.inf


def _checked_rest(
    fingers: int, modes: int, target_um: npt.ArrayLike, limit_um: npt.ArrayLike, previous_um: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    if modes < 1:
        raise ValueError("phi: has no modes; its last axis must hold at least one.")
    targets = _checked("target_um", target_um, (fingers,))
    if (targets < 0.0).any():
        raise ValueError("target_um: amplitudes must be 0 or more; the solver chooses the sign.")
    if isinstance(limit_um, (float, int)):
        limit_um = [limit_um] * modes
    limits = _checked("limit_um", limit_um, (modes,))
    if not (limits > 0.0).all():
        raise ValueError("limit_um: every limit must be greater than 0.")
    return targets, limits, None if previous_um is None else _checked("previous_um", previous_um, (modes,))


def _checked(name: str, values: npt.ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: must be an array of numbers, all rows of the same length.") from None
    if array.ndim != len(shape):
        raise ValueError(f"{name}: has {array.ndim} dimensions and needs {len(shape)}.")
    if any(asked is not None and asked != found for asked, found in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name}: has shape {array.shape}, but phi asks for {shape}.")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")
    return array
