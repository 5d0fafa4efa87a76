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

Cost: two on two in plain floats, some times the real solution of one that is still; else two real solutions a step in
a turn.
"""

from __future__ import annotations

import math
from typing import Final

from .arithmetic import Pair, Row, Shapes2, length
from .box import shapes_of
from .pair import amplitudes, excess_error, into_box, meeting, misses_either
from .phase_continuation import Phasors, in_phase, magnitude, turn_patterns
from .policies import Rows, all_finite, solve_fast
from .slew_limit import Phasors2, eased, given, nearer_hand

Swing = tuple[float, float, float]  # middle and span of a |w|^2, and the |w| that is wanted

TURN_RAD: Final = math.pi / 8  # the chord between knots this far apart sags by 2 % of |w| at most
_SAFE: Final = 1e100  # squares of larger ratios would leave the range of floats
_CANCELLING: Final = 1e6  # of a limit: two phasors so great leave no phase but pi between them, and digits of rounding
_UNFELT: Final = 0.02  # of a target: less than this no finger feels
_HALVINGS: Final = 32  # to 1e-9 of the cosine, the error being flat there


def solve_phased_fast(
    rows: Rows, targets: Row, limits: Row, previous: Phasors | None = None, turn_rad: float = TURN_RAD
) -> tuple[Phasors, bool]:
    """`solver.solve_phased` for callers that have checked their input: modal phasors in um, and `limited`."""
    if len(rows) == 2 == len(limits):
        return _two_on_two(rows, targets, limits, previous, turn_rad)
    if previous is not None and not all(magnitude(w) < _SAFE for w in previous):
        previous = None
    if previous is not None and sum([target > 0.0 for target in targets]) >= 2 and all_finite(rows):
        return turn_patterns(rows, targets, limits, previous, turn_rad)
    modal, limited = solve_fast(rows, targets, limits)
    return in_phase(modal, limits, previous), limited


# --- two fingers on two modes ---------------------------------------------------------------------------------------


def _two_on_two(
    rows: Rows, targets: Row, limits: Row, previous: Phasors | None, turn_rad: float
) -> tuple[Phasors, bool]:
    first, second = targets[0], targets[1]
    box = limits[0], limits[1]
    now = (0.0, 0.0, 0.0, 0.0) if previous is None or not max(box[0], box[1]) < _SAFE else _parts(previous)
    if first > 0.0 < second and all_finite(rows):
        (x, x_j, y, y_j), limited = _both_slip(shapes_of(rows), (first, second), box, now, turn_rad)
    else:
        modal, limited = solve_fast(rows, targets, limits)
        x, x_j, y, y_j = nearer_hand((modal[0], 0.0, modal[1], 0.0), box, now)
    return (complex(x, x_j), complex(y, y_j)), limited


def _parts(phasors: Phasors) -> Phasors2:
    """As plain floats; beyond all sense is silence."""
    one, other = phasors[0], phasors[1]
    a, b, c, d = one.real, one.imag, other.real, other.imag
    return (a, b, c, d) if length(a, b) < _SAFE and length(c, d) < _SAFE else (0.0, 0.0, 0.0, 0.0)


def _both_slip(
    shapes: Shapes2, targets: Pair, limits: Pair, previous: Phasors2, turn_rad: float
) -> tuple[Phasors2, bool]:
    """Two slipping fingers. Where they see the modes alike a common phase is all there is."""
    first_x, first_y, is_met = meeting(shapes, targets[0], 0.0)
    second_x, second_y, is_other_met = meeting(shapes, 0.0, targets[1])
    if not (is_met and is_other_met):
        return _real(shapes, targets, limits, previous)
    low, high = _cosines((first_x, first_y), (second_x, second_y), limits)
    if not low <= high:
        return _at_limits(shapes, targets, limits, previous, turn_rad)
    cos = low if first_x * second_x + first_y * second_y > 0.0 else high  # |W|^2 is least there
    now_rad = _phase_between(given(shapes, previous))
    if now_rad is not None:
        tau_rad = min(max(math.acos(cos), now_rad - turn_rad), now_rad + turn_rad)
        cos = min(max(math.cos(tau_rad), low), high)
    sin = math.sqrt((1.0 - cos) * (1.0 + cos))
    modal = first_x + cos * second_x, sin * second_x, first_y + cos * second_y, sin * second_y
    return _eased(shapes, targets, limits, modal, previous, turn_rad), False


def _real(shapes: Shapes2, targets: Pair, limits: Pair, previous: Phasors2) -> tuple[Phasors2, bool]:
    """The real solution, its common phase as near to the present one as may be."""
    a, b, c, d = shapes
    modal, limited = solve_fast(((a, b), (c, d)), targets, limits)
    return nearer_hand((modal[0], 0.0, modal[1], 0.0), limits, previous), limited


def _eased(
    shapes: Shapes2, targets: Pair, limits: Pair, wanted: Phasors2, previous: Phasors2, turn_rad: float
) -> Phasors2:
    """As much of the way to the wanted phasors as no finger feels (`solver_ease`).

    The best X jumps where fingers at the limits pass a singular position: what neither of them sees changes its sign.
    """
    keep = math.cos(min(turn_rad, math.pi) / 2)
    return eased(shapes, limits, wanted, previous, keep, (_UNFELT * targets[0], _UNFELT * targets[1]))


def _cosines(first: Pair, second: Pair, limits: Pair) -> Pair:
    """The cosines of tau, least and greatest, for which |first_k + exp(j tau) second_k| <= limit_k in both modes.

    The least is above the greatest where there are none.
    """
    low, high = _cosines_of(first[0] / limits[0], second[0] / limits[0])
    other_low, other_high = _cosines_of(first[1] / limits[1], second[1] / limits[1])
    return max(low, other_low), min(high, other_high)


def _cosines_of(u: float, v: float) -> Pair:
    """The cosines of tau for which |u + exp(j tau) v| <= 1."""
    if not (abs(u) < _CANCELLING and abs(v) < _CANCELLING):
        return 1.0, -1.0
    room, slope = 1.0 - u * u - v * v, 2.0 * u * v
    if slope > 0.0:
        return -1.0, min(room / slope, 1.0)
    if slope < 0.0:
        return max(room / slope, -1.0), 1.0
    return (-1.0, 1.0) if room >= 0.0 else (1.0, -1.0)


def _phase_between(fingers: Phasors2) -> float | None:
    """The angle between the phasors of two fingers, 0 to pi; None where one of them is still."""
    a, b, c, d = fingers
    along, across = c * a + d * b, d * a - c * b
    return abs(math.atan2(across, along)) if 0.0 < length(along, across) < math.inf else None


def _at_limits(
    shapes: Shapes2, targets: Pair, limits: Pair, previous: Phasors2, turn_rad: float
) -> tuple[Phasors2, bool]:
    """No phase serves both fingers: the best of both sign patterns and of both modes at their limits."""
    a, b, c, d = shapes
    size = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
    least_limit, greatest = min(limits[0], limits[1]), max(max(limits[0], limits[1]), max(targets[0], targets[1]))
    if not (1.0 / _SAFE < size < _SAFE and least_limit > 1.0 / _SAFE and greatest < _SAFE):
        return _real(shapes, targets, limits, previous)
    best, got = _best_of_signs(shapes, targets, limits)
    cos = _best_cosine(shapes, targets, limits)
    if -1.0 < cos < 1.0:
        sin = math.sqrt((1.0 - cos) * (1.0 + cos))
        turned = limits[0], 0.0, limits[1] * cos, limits[1] * sin
        turned_got = _magnitudes(given(shapes, turned))
        if not excess_error(got, turned_got, targets) < 0.0:
            best, got = turned, turned_got
    return _eased(shapes, targets, limits, best, previous, turn_rad), misses_either(got, targets)


def _best_of_signs(shapes: Shapes2, targets: Pair, limits: Pair) -> tuple[Phasors2, Pair]:
    """The better of the two sign patterns, and what it gives the fingers."""
    first, second = targets
    x, y, _ = meeting(shapes, first, second)
    x, y, _ = into_box((x, y), shapes, targets, limits)
    p, q, _ = meeting(shapes, first, -second)
    p, q, _ = into_box((p, q), shapes, (first, -second), limits)
    got, other_got = amplitudes(shapes, (x, y)), amplitudes(shapes, (p, q))
    if excess_error(other_got, got, targets) < 0.0:
        return (p, 0.0, q, 0.0), other_got
    return (x, 0.0, y, 0.0), got


def _best_cosine(shapes: Shapes2, targets: Pair, limits: Pair) -> float:
    """cos theta of the second mode against the first, both at their limits: where the error, which is convex, is least.

    -1 or 1 where that is real: a corner of the box.
    """
    a, b, c, d = shapes
    one, other = _swing(a * limits[0], b * limits[1], targets[0]), _swing(c * limits[0], d * limits[1], targets[1])
    low, high = -1.0, 1.0
    if not _slope(one, other, low) < 0.0:
        return low
    if not _slope(one, other, high) > 0.0:
        return high
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if _slope(one, other, middle) < 0.0:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def _swing(u: float, v: float, target: float) -> Swing:
    """Of a finger's |w|^2 with both modes at their limits: its middle, and how far it swings; and the target."""
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


def _magnitudes(phasors: Phasors2) -> Pair:
    a, b, c, d = phasors
    return length(a, b), length(c, d)
