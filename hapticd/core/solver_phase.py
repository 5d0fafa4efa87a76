"""Complex modal amplitudes: a slipping finger changes sign by turning its phase, and never feels it.

Friction knows |w_i| only, and the firmware controls both axes of the rotating frame, so phases are as free as signs.
Any two real solutions P and Q are the ends of a turn,

    W(tau) = exp(j tau/2) (P cos(tau/2) - j Q sin(tau/2)),   0 <= tau <= pi,

on which every |w_i|^2 and every |W_k|^2 is the mean of its values at the ends, weighted by cos^2 and sin^2: the cross
term is imaginary. Fingers that both ends serve are served all the way, still fingers stay still, limits hold. Where
`core.solver` jumps from one sign pattern to another, and every finger that changes its sign is carried through 0, the
phase between those that change and those that do not turns by at most `turn_rad` a step.

Two slipping fingers on two modes are solved to the end. With X = Re(W W^H), |w_i|^2 = phi_i' X phi_i and |W_k|^2 = X_kk
are linear, and every X >= 0 has a W, so rules (1) to (4) of `core.solver` are a convex programme in X:
* both fingers get their targets for an interval of cos tau, all |W_k|^2 being affine in it. Its end of least |W|^2 is
  where the turn heads for; with signs alone only tau = 0 and pi could serve.
* where that interval is empty, at most one limit met means W real (`solver_box`); both met, W = (L1, L2 e^(j theta)),
  and the error is convex in cos theta. The best of these is the best of all.
Up to sqrt(2) more amplitude than with signs, where two fingers see the modes unlike; nothing near a singular position,
where fingers see them alike and one of the signs is best anyway. What jumps there, the amplitude along what neither
finger sees, turns as well: from one X to another leads a straight line, and on it every square goes straight too.

More fingers or modes turn between their real solutions: no finger ever gets less than at the worse end, but what a
third phase could add is left. `effort` has no part in this.

Cost: two on two in plain floats, two to three times the real solution; else two real solutions a step in a turn.
"""

from __future__ import annotations

import math
from typing import Final

from .solver_arithmetic import Pair, Row
from .solver_box import box_least_squares, square_solution
from .solver_choice import misses
from .solver_ease import Phasors2, Shapes2, eased, given, nearer_hand
from .solver_policies import Rows, all_finite, solve_fast
from .solver_turn import Phasors, in_phase, magnitude, turn_patterns

Swing = tuple[float, float, float]  # middle and span of a |w|^2, and the |w| that is wanted

TURN_RAD: Final = math.pi / 8  # the chord between knots this far apart sags by 2 % of |w| at most
_SAFE: Final = 1e100  # squares of larger ratios would leave the range of floats
_UNFELT: Final = 0.02  # of a target: less than this no finger feels
_HALVINGS: Final = 32  # to 1e-9 of the cosine, the error being flat there


def solve_phased_fast(
    rows: Rows, targets: Row, limits: Row, previous: Phasors | None = None, turn_rad: float = TURN_RAD
) -> tuple[Phasors, bool]:
    """`solver.solve_phased` for callers that have checked their input: modal phasors in um, and `limited`."""
    if previous is not None and not all(magnitude(w) < _SAFE for w in previous):
        previous = None
    if sum([target > 0.0 for target in targets]) >= 2 and all_finite(rows):
        if len(rows) == 2 == len(limits):
            pair = _pair(rows, targets, (limits[0], limits[1]), previous, turn_rad)
            if pair is not None:
                return pair
        elif previous is not None:
            return turn_patterns(rows, targets, limits, previous, turn_rad)
    return _real(rows, targets, limits, previous)


def _real(rows: Rows, targets: Row, limits: Row, previous: Phasors | None) -> tuple[Phasors, bool]:
    """The real solution, its common phase as near to the present one as may be."""
    modal, limited = solve_fast(rows, targets, limits)
    return in_phase(modal, limits, previous), limited


# --- two fingers on two modes ---------------------------------------------------------------------------------------


def _pair(
    rows: Rows, targets: Row, limits: Pair, previous: Phasors | None, turn_rad: float
) -> tuple[Phasors, bool] | None:
    """Two slipping fingers; None where they see the modes alike and a common phase is all there is."""
    first = square_solution(rows, (targets[0], 0.0))
    second = square_solution(rows, (0.0, targets[1]))
    if first is None or second is None:
        return None
    cosines = _cosines(first, second, limits)
    if cosines is None:
        return _pair_at_limits(rows, targets, limits, previous, turn_rad)
    low, high = cosines
    falls = first[0] * second[0] + first[1] * second[1] > 0.0  # |W|^2 with cos tau falling
    tau_rad = math.acos(low if falls else high)
    now_rad = None if previous is None else _phase_between(_shapes(rows), _parts(previous))
    if now_rad is not None:
        tau_rad = min(max(tau_rad, now_rad - turn_rad), now_rad + turn_rad)
    cos = min(max(math.cos(tau_rad), low), high)
    sin = math.sqrt((1.0 - cos) * (1.0 + cos))
    modal = first[0] + cos * second[0], sin * second[0], first[1] + cos * second[1], sin * second[1]
    return _eased(rows, targets, limits, modal, previous, turn_rad), False


def _eased(
    rows: Rows, targets: Row, limits: Pair, wanted: Phasors2, previous: Phasors | None, turn_rad: float
) -> Phasors:
    """As much of the way to the wanted phasors as no finger feels (`solver_ease`).

    The best X jumps where fingers at the limits pass a singular position: what neither of them sees changes its sign.
    """
    if previous is None:
        a, b, c, d = nearer_hand(wanted, limits, (0.0, 0.0, 0.0, 0.0))
    else:
        keep = math.cos(min(turn_rad, math.pi) / 2)
        unfelt_um = _UNFELT * targets[0], _UNFELT * targets[1]
        a, b, c, d = eased(_shapes(rows), limits, wanted, _parts(previous), keep, unfelt_um)
    return complex(a, b), complex(c, d)


def _shapes(rows: Rows) -> Shapes2:
    (a, b), (c, d) = rows
    return a, b, c, d


def _parts(phasors: Phasors) -> Phasors2:
    one, other = phasors
    return one.real, one.imag, other.real, other.imag


def _cosines(first: Pair, second: Pair, limits: Pair) -> Pair | None:
    """The cosines of tau for which |first_k + exp(j tau) second_k| <= limit_k in both modes; None if there are none."""
    low, high = -1.0, 1.0
    for one, other, limit in zip(first, second, limits, strict=True):
        u, v = one / limit, other / limit
        if not (abs(u) < _SAFE and abs(v) < _SAFE):
            return None
        room, slope = 1.0 - u * u - v * v, 2.0 * u * v
        if slope > 0.0:
            high = min(high, room / slope)
        elif slope < 0.0:
            low = max(low, room / slope)
        elif room < 0.0:
            return None
    return (low, high) if low <= high else None


def _phase_between(shapes: Shapes2, modal: Phasors2) -> float | None:
    """The angle between the phasors of two fingers, 0 to pi; None where one of them is still."""
    a, b, c, d = given(shapes, modal)
    along, across = c * a + d * b, d * a - c * b
    return abs(math.atan2(across, along)) if 0.0 < math.hypot(along, across) < math.inf else None


def _pair_at_limits(
    rows: Rows, targets: Row, limits: Pair, previous: Phasors | None, turn_rad: float
) -> tuple[Phasors, bool]:
    """No phase serves both fingers: the best of both sign patterns and of both modes at their limits."""
    size = max([abs(value) for row in rows for value in row])
    if not (1.0 / _SAFE < size < _SAFE and min(limits) > 1.0 / _SAFE and max(*limits, *targets) < _SAFE):
        return _real(rows, targets, limits, previous)
    turn = _best_turn(rows, targets, limits)
    candidates: list[Phasors2] = []
    if turn is not None:
        candidates.append((limits[0], 0.0, limits[1] * turn[0], limits[1] * turn[1]))
    for sign in (1.0, -1.0):
        real, _ = box_least_squares(rows, (targets[0], sign * targets[1]), limits, 0.0)
        candidates.append((real[0], 0.0, real[1], 0.0))
    shapes = _shapes(rows)
    best, amplitudes = candidates[0], _amplitudes(shapes, candidates[0])
    for modal in candidates[1:]:
        others = _amplitudes(shapes, modal)
        if _excess(others, amplitudes, targets) < 0.0:
            best, amplitudes = modal, others
    return _eased(rows, targets, limits, best, previous, turn_rad), misses(amplitudes, targets)


def _best_turn(rows: Rows, targets: Row, limits: Pair) -> Pair | None:
    """cos theta, sin theta of the second mode against the first, both at their limits: where the error is least.

    It is convex. None where that is real: a corner of the box, and `solver_box` knows it.
    """
    one, other = _swing(rows[0], limits, targets[0]), _swing(rows[1], limits, targets[1])
    low, high = -1.0, 1.0
    if not _slope(one, other, low) < 0.0 < _slope(one, other, high):
        return None
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if _slope(one, other, middle) < 0.0:
            low = middle
        else:
            high = middle
    cos = (low + high) / 2
    return cos, math.sqrt((1.0 - cos) * (1.0 + cos))


def _swing(row: Row, limits: Pair, target: float) -> Swing:
    """Of a finger's |w|^2 with both modes at their limits: its middle, and how far it swings; and the target."""
    u, v = row[0] * limits[0], row[1] * limits[1]
    return u * u + v * v, 2.0 * u * v, target


def _slope(one: Swing, other: Swing, cos: float) -> float:
    """By how much the two fingers' error rises with cos theta: a rising function, for the error is convex."""
    return _pull(one, cos) + _pull(other, cos)


def _pull(swing: Swing, cos: float) -> float:
    middle, span, target = swing
    if span == 0.0:
        return 0.0
    reached = math.sqrt(max(middle + span * cos, 0.0))
    return span * (1.0 - target / reached) if reached > 0.0 else -math.copysign(math.inf, span)


def _amplitudes(shapes: Shapes2, modal: Phasors2) -> Pair:
    a, b, c, d = given(shapes, modal)
    return math.hypot(a, b), math.hypot(c, d)


def _excess(one: Pair, other: Pair, targets: Row) -> float:
    """Squared error of `one` above that of `other`, without the targets' squares."""
    (v, w), (u, t) = one, other
    return (v - u) * (v + u - 2.0 * targets[0]) + (w - t) * (w + t - 2.0 * targets[1])
