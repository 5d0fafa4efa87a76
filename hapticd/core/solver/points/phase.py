"""Complex modal amplitudes: a slipping finger changes sign by turning its phase, without a dip.

Friction depends on |w_i| only, and the firmware controls both axes of the rotating frame, so phases are as free as
signs. Any two real solutions P and Q are the ends of a turn,

    W(tau) = exp(j tau/2) (P cos(tau/2) - j Q sin(tau/2)),   0 <= tau <= pi,

on which every |w_i|^2 and every |W_k|^2 is the mean of its values at the ends, weighted by cos^2 and sin^2: the cross
term is imaginary. Fingers that both ends serve are served all the way, still fingers stay still, limits hold. Where
`solve` jumps from one sign pattern to another, and every finger that changes its sign is carried through 0, the phase
between those that change and those that do not turns by at most `turn_rad` a step.

Two slipping fingers on two modes are solved exactly. With X = Re(W W^H), |w_i|^2 = phi_i' X phi_i and |W_k|^2 = X_kk
are linear, and every X >= 0 has a W, so rules (1) to (4) of `public` are a convex programme in X:
* both fingers get their targets for an interval of cos tau, all |W_k|^2 being affine in it. The turn heads for its end
  of least |W|^2; with signs alone only tau = 0 and pi could serve.
* where that interval is empty, at most one limit met means W real (`general.serve_both`); both met, W =
  (L1, L2 e^(j theta)), and the error is convex in cos theta. The best of these is the best of all.
Free phases give up to sqrt(2) more amplitude than signs where two fingers see the modes unlike, and nothing near a
singular position, where one of the signs is best anyway. What jumps there, the amplitude along what neither finger
sees, turns as well (`slew_limit.eased`).

More fingers or modes descend from the present phasors (`descent`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ...phasors import SAFE, ModeRow, ModeRows, Pair, Phasors, Shapes2, all_finite, magnitude
from .descent import serve_many
from .general import amplitudes, excess_error, in_range, meeting, misses_either, serve_both, solve_fast
from .line import solve_line
from .slew_limit import Phasors2, eased, given, nearer_hand

Swing = tuple[float, float, float]  # middle and span of a |w|^2, and the |w| that is wanted

TURN_RAD: Final = math.pi / 8  # the chord between knots this far apart sags by 2 % of |w| at most
_CANCELLING: Final = 1e6  # of a limit: between phasors so much larger only the phase pi fits, and digits are rounding
_UNFELT: Final = 0.02  # of a target: less than this no finger feels
_HALVINGS: Final = 32  # to 1e-9 of the cosine, the error being flat there


def solve_phased_fast(
    rows: ModeRows,
    targets: ModeRow,
    limits: ModeRow,
    previous: Phasors | None = None,
    turn_rad: float = TURN_RAD,
    *,
    descends: bool = False,
) -> tuple[Phasors, bool]:
    """`solver.solve_phased` for callers that have checked their input: modal phasors in um, and `limited`.

    `descends`: as with many fingers, however few they are.
    """
    if len(rows) == 2 == len(limits) and not descends:
        return _two_on_two(rows, targets, limits, previous, turn_rad)
    if previous is not None and not all(magnitude(w.real, w.imag) < SAFE for w in previous):
        previous = None
    line = solve_line(rows, targets, limits)  # all that can turn is the common phase, as with one slipping finger
    if line is not None or sum([target > 0.0 for target in targets]) < 2:
        modal, limited = solve_fast(rows, targets, limits) if line is None else line
        return in_phase(modal, limits, previous), limited
    d_um, q_um = [0.0] * len(limits), [0.0] * len(limits)
    if previous is not None:
        for mode in range(len(limits)):
            d_um[mode], q_um[mode] = previous[mode].real, previous[mode].imag
    limited = serve_many(rows, targets, limits, d_um, q_um, is_real=False)
    return tuple(map(complex, d_um, q_um)), limited


def in_phase(modal: Sequence[complex], limits: ModeRow, previous: Phasors | None) -> Phasors:
    """The `nearer_hand` of a solution, in complex numbers; without `previous` it stays as it is, within the limits."""
    near = (0j,) * len(modal) if previous is None else previous
    flat = nearer_hand(_flat(modal), limits, _flat(near))
    return tuple([complex(flat[2 * k], flat[2 * k + 1]) for k in range(len(limits))])


def _flat(phasors: Sequence[complex]) -> ModeRow:
    return tuple([part for w in phasors for part in (w.real, w.imag)])


# --- two fingers on two modes ---------------------------------------------------------------------------------------


def _two_on_two(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: Phasors | None, turn_rad: float
) -> tuple[Phasors, bool]:
    first, second, box = targets[0], targets[1], (limits[0], limits[1])
    now = (0.0, 0.0, 0.0, 0.0) if previous is None or not max(box[0], box[1]) < SAFE else _parts(previous)
    if first > 0.0 < second and all_finite(rows):
        one, other = rows[0], rows[1]
        shapes = one[0], one[1], other[0], other[1]
        (x, x_j, y, y_j), limited = _both_slip(shapes, (first, second), box, now, turn_rad)
    else:
        (x, x_j, y, y_j), limited = _real(rows, targets, limits, now)
    return (complex(x, x_j), complex(y, y_j)), limited


def _parts(phasors: Phasors) -> Phasors2:
    """Phasors as plain floats; those beyond all sense count as silence."""
    one, other = phasors[0], phasors[1]
    a, b, c, d = one.real, one.imag, other.real, other.imag
    return (a, b, c, d) if magnitude(a, b) < SAFE and magnitude(c, d) < SAFE else (0.0, 0.0, 0.0, 0.0)


def _both_slip(
    shapes: Shapes2, targets: Pair, limits: Pair, previous: Phasors2, turn_rad: float
) -> tuple[Phasors2, bool]:
    """Two slipping fingers; with parallel rows only their common phase is free."""
    first_x, first_y, is_met = meeting(shapes, targets[0], 0.0)
    second_x, second_y, is_other_met = meeting(shapes, 0.0, targets[1])
    if not (is_met and is_other_met):
        return _real(_rows_of(shapes), targets, limits, previous)
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


def _real(rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: Phasors2) -> tuple[Phasors2, bool]:
    """The real solution at the common phase that is nearest to the present one."""
    modal, limited = solve_fast(rows, targets, limits)
    turned = nearer_hand((modal[0], 0.0, modal[1], 0.0), limits, previous)
    return (turned[0], turned[1], turned[2], turned[3]), limited


def _rows_of(shapes: Shapes2) -> ModeRows:
    a, b, c, d = shapes
    return (a, b), (c, d)


def _eased(
    shapes: Shapes2, targets: Pair, limits: Pair, wanted: Phasors2, previous: Phasors2, turn_rad: float
) -> Phasors2:
    """As much of the way to the wanted phasors as no finger feels.

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
    return abs(math.atan2(across, along)) if 0.0 < magnitude(along, across) < math.inf else None


def _at_limits(
    shapes: Shapes2, targets: Pair, limits: Pair, previous: Phasors2, turn_rad: float
) -> tuple[Phasors2, bool]:
    """No phase serves both fingers: the best of both sign patterns and of both modes at their limits."""
    if not (in_range(shapes, targets) and min(limits[0], limits[1]) > 1.0 / SAFE and max(limits[0], limits[1]) < SAFE):
        return _real(_rows_of(shapes), targets, limits, previous)
    x, y, _, _ = serve_both(shapes, targets, limits, (0.0, 0.0))
    best, got = (x, 0.0, y, 0.0), amplitudes(shapes, (x, y))
    cos = _best_cosine(shapes, targets, limits)
    if -1.0 < cos < 1.0:
        sin = math.sqrt((1.0 - cos) * (1.0 + cos))
        turned = limits[0], 0.0, limits[1] * cos, limits[1] * sin
        p, p_j, q, q_j = given(shapes, turned)
        turned_got = magnitude(p, p_j), magnitude(q, q_j)
        if not excess_error(got, turned_got, targets) < 0.0:
            best, got = turned, turned_got
    return _eased(shapes, targets, limits, best, previous, turn_rad), misses_either(got, targets)


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
    """A finger's |w|^2 with both modes at their limits: its middle and its span; and the target."""
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
