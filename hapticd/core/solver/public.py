"""Modal amplitudes that give each finger its own vibration: w = Phi W, |w_i| wanted, |W_k| limited (paper, eq. 1-3).

`keep_zero`, the default, is lexicographic. In this order: (1) |W_k| <= limit_k, always, to the last bit; (2) fingers
with target 0 get 0; (3) the others' sum (|w_i| - a_i)^2 is least, their signs being free, for friction knows only
|w_i|; (4) then sum |W_k|^2 is least; (5) of equals, the one nearest `previous_um`. A pair of fingers near a singular
position is therefore met by amplitudes that stay where they are, where the inverse of Phi flips from limit to limit.

`keep_ratio`     as `keep_zero` without limits, then all modes scaled into them: the fingers' ratios survive.
`least_squares`  a finger with target 0 counts like any other in (3): some leak there, less error elsewhere.
`priority`       fingers are served in the order of their rows, still or slipping: see
`bench.baselines.solver_priority`. `paper`          the founding paper's scheme, as a baseline: the inverse of Phi,
signs fixed, scaled into the limits
                 (section IV.B). It needs two fingers and two modes; otherwise it is `keep_zero` from scratch.

`effort` > 0 adds effort * |W|^2 to (3): amplitudes fade towards a singular position instead of riding the limit.
`hysteresis` > 0 lets (5) decide between sign patterns whose error and |W|^2 differ by no more than that share. Two
slipping fingers have two patterns; where their norms cross, (4) alone would jump between them with every wobble.
At an exactly singular position (4) gives W = 0, as coincident fingers want; only `effort` makes the way there smooth.
`gram` puts contact discs in the place of the still fingers' points: see `core.solver.contacts`.

`solve_phased` also frees the phases: a change of pattern becomes a rotation that no finger feels
(`core.solver.phase`).

Cost, N fingers, M modes: up to 2 x 2 plain floats and closed forms. Two modes: O(n^2) for n slipping fingers. Three
and more: see `core.solver.general`. What each takes stands in `hapticd bench solver`.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...values import Solution
from .arithmetic import Row
from .box import shapes_of
from .checks import (
    FloatArray,
    Rows,
    check_weight,
    checked_gram_track,
    checked_grams,
    checked_limits,
    checked_phasors,
    checked_previous,
    checked_shapes,
    checked_target_track,
    checked_targets,
    checked_track,
    plain_pair,
    plain_rows,
)
from .contacts import contact_problem, contact_track
from .pair import amplitudes, condition, hold_still
from .phase import TURN_RAD, solve_phased_fast
from .policies import named, solve_fast

_array: Final = np.array  # looked up once

__all__ = ["condition_number", "solve", "solve_batch", "solve_fast", "solve_phased", "solve_phased_fast"]


def solve(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    previous_um: npt.ArrayLike | None = None,
    hysteresis: float = 0.0,
    gram: npt.ArrayLike | None = None,
) -> Solution:
    """Modal amplitudes for one instant.

    phi (N, M): mode shapes at the fingers; target_um (N,); limit_um (M,) or one number; previous_um (M,) or None;
    gram (N, M, M) or None: the mean of phi_k phi_l over each finger's contact.
    Raises ValueError, in one sentence, for wrong shapes, numbers that are not finite, negative targets, effort or
    hysteresis, limits that are not positive, an unknown policy.
    """
    if gram is None and effort == hysteresis == 0.0:
        solution = _solve_pair(phi, target_um, limit_um, previous_um, policy)
        if solution is not None:
            return solution
    rows, modes = checked_shapes(phi)
    targets = checked_targets(target_um, len(rows))
    limits, previous = checked_limits(limit_um, modes), checked_previous(previous_um, modes)
    check_weight("effort", effort)
    check_weight("hysteresis", hysteresis)
    served, wanted = rows, targets
    if gram is not None:
        served, wanted = contact_problem(rows, targets, checked_grams(gram, len(rows), modes))
    modal, limited = solve_fast(served, wanted, limits, previous, policy, effort, hysteresis)
    achieved = [_amplitude(row, modal) for row in rows]
    return Solution(np.array(modal), np.array(achieved), limited, _condition(rows))


def solve_batch(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    previous_um: npt.ArrayLike | None = None,
    hysteresis: float = 0.0,
    gram: npt.ArrayLike | None = None,
) -> FloatArray:
    """Modal amplitudes (K, M) for K instants in order; each is the next one's `previous_um`.

    phi (K, N, M); target_um (K, N), or (N,) for all instants; gram (K, N, M, M) or None; the rest as in `solve`.
    """
    track, fingers, modes = checked_track(phi)
    targets = checked_target_track(target_um, len(track), fingers)
    limits, previous = checked_limits(limit_um, modes), checked_previous(previous_um, modes)
    check_weight("effort", effort)
    check_weight("hysteresis", hysteresis)
    named(policy)
    if gram is not None:
        grams = checked_gram_track(gram, len(track), fingers, modes)
        track, targets = contact_track(track, targets, grams)
    modal_um = []
    for rows, target in zip(track, targets, strict=True):
        previous, _ = solve_fast(rows, target, limits, previous, policy, effort, hysteresis)
        modal_um.append(previous)
    return np.array(modal_um).reshape(len(track), modes)


def solve_phased(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    previous_um: npt.ArrayLike | None = None,
    turn_rad: float = TURN_RAD,
    gram: npt.ArrayLike | None = None,
) -> npt.NDArray[np.complex128]:
    """Complex modal amplitudes (M,) for one instant, `keep_zero` with the fingers' phases free.

    phi, target_um, limit_um, gram as in `solve`; previous_um (M,) complex or None; `turn_rad`: how far the phase
    between fingers may turn from what `previous_um` gives them, where their amplitudes leave the choice.
    Raises ValueError as `solve` does.
    """
    rows, modes = checked_shapes(phi)
    targets = checked_targets(target_um, len(rows))
    limits, previous = checked_limits(limit_um, modes), checked_phasors(previous_um, modes)
    check_weight("turn_rad", turn_rad)
    if gram is not None:
        rows, targets = contact_problem(rows, targets, checked_grams(gram, len(rows), modes))
    return np.array(solve_phased_fast(rows, targets, limits, previous, turn_rad)[0])


def condition_number(phi: FloatArray) -> float:
    """The 2-norm condition number of phi (N, M), inf where it is singular to rounding, 1 where it is empty."""
    return _condition(tuple(map(tuple, phi.tolist())))


def _solve_pair(phi: Any, target_um: Any, limit_um: Any, previous_um: Any, policy: str) -> Solution | None:
    """`solve` for two fingers on two modes, the case of nearly every call: told in floats, or in arrays of them.

    None for all else, be it right or wrong: the full checks tell. A sum less itself is 0 for finite numbers only.
    """
    try:
        one, other = plain_rows(phi)
        (a, b), (c, d) = plain_pair(one), plain_pair(other)
        first, second = plain_pair(target_um)
        limit_x, limit_y = (limit_um, limit_um) if type(limit_um) is float else plain_pair(limit_um)
        x, y = (0.0, 0.0) if previous_um is None else plain_pair(previous_um)
    except TypeError:
        return None
    total = a + b + c + d + first + second + limit_x + limit_y + x + y
    if not (first >= 0.0 and second >= 0.0 and limit_x > 0.0 and limit_y > 0.0 and total - total == 0.0):
        return None
    shapes, limits = (a, b, c, d), (limit_x, limit_y)
    if policy == "keep_zero" and second == 0.0 < first and (c != 0.0 or d != 0.0):
        w_x, w_y, limited = hold_still((a, b), first, (c, d), limits, (x, y))
    else:
        previous = None if previous_um is None else (x, y)
        modal, limited = solve_fast(((a, b), (c, d)), (first, second), limits, previous, policy)
        w_x, w_y = modal
    got = amplitudes(shapes, (w_x, w_y))
    if not got[0] + got[1] < math.inf:
        got = _amplitude((a, b), (w_x, w_y)), _amplitude((c, d), (w_x, w_y))
    return Solution(_array((w_x, w_y)), _array(got), limited, condition(shapes))


def _amplitude(row: Row, modal: Row) -> float:
    amplitude = abs(sum([shape * w for shape, w in zip(row, modal, strict=True)]))
    if amplitude < math.inf:
        return amplitude
    size = max([abs(shape) for shape in row])  # products beyond the range of floats may still cancel
    return abs(sum([shape / size * w for shape, w in zip(row, modal, strict=True)])) * size


def _condition(rows: Rows) -> float:
    if len(rows) == 2 == len(rows[0]):
        return condition(shapes_of(rows))
    if not rows:
        return 1.0
    matrix = np.array(rows)
    size = float(np.max(np.abs(matrix)))
    if size == 0.0:
        return math.inf
    singular = np.linalg.svd(matrix / size, compute_uv=False)
    largest, smallest = float(singular[0]), float(singular[-1])
    return largest / smallest if smallest > 0.0 else math.inf
