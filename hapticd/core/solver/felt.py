"""Friction as asked over whole contacts: modal amplitudes that make the largest error, in just noticeable differences,
least.

Friction is convex in amplitude: a contact whose RMS is as asked feels stickier, the more so the less even the vibration
is. So what counts is its mean over the contact. With F the friction curve, phi_q the shapes at the contact's points q,
c_q their weights, and F_i* the friction that the finger's target has when it is the same all over the contact,

    u_i = (F_i - F_i*) / (WEBER_FRAC F_i*),    F_i = sum_q c_q F(r_q)
    r_q^2 = |phi_q W|^2 + UNCERTAIN_FRAC^2 sum_k |phi_qk W_k|^2

are the errors, and max |u_i| is least within |W_k| <= L_k. r_q is what is to be expected: each mode errs by a share of
its amplitude, by map, gain and sensor together. Where not all can be had, the error of a finger that should stick
counts in full, and of any other at most MOST_SLIPPERY of a just noticeable difference: the sticky one is as asked, and
the others get what is left. Priorities come before that: of a finger whose priority is lower than another's, less
counts (`counted_jnd`).

Each iteration

1.  weighs the fingers: the logarithm of alpha_i moves by RATE towards that of |u_i|, less the mean over the fingers
    (multiplicative weights: S. Arora, E. Hazan and S. Kale, Theory of Computing 8, 2012);
2.  replaces sum alpha_i |F_i - F_i*| by a sum of squares, point by point, that has its slope at the present W. A sticky
    finger's points are pulled to 0, as |r| is (iteratively reweighted least squares); another's to r
    plus the change that would make F_i right if all points changed alike. Over the frictions TO_ZERO one passes into
    the other, within what is felt;
3.  sweeps over the modes, each moved to its best, or PAST_FRAC past it, and into its limit (over-relaxation:
    D. M. Young, Trans. AMS 76, 1954).

It starts from the last W and the last weights, so W follows the fingers continuously: phases are free and nothing
flips. From there it stays near the best of many starts (`hapticd bench felt`). `felt_descent` is the iteration.
"""

from __future__ import annotations

import math
from typing import Final

from ..friction import FrictionCurve
from ..phasors import ModeRow
from ..plate.contact import Disc, Shapes
from .felt_descent import descend

ITERATIONS: Final = 7  # of a call
COLD_ITERATIONS: Final = 60  # from rest
FIRST_IN_PART: Final = 0.7  # friction from which on errors count in full where not all can be had, in part
FIRST: Final = 0.9  # and altogether
MOST_SLIPPERY: Final = 0.9  # of a just noticeable difference: as much of a slippery finger's error counts
MOST_LOWER: Final = 0.7  # of what counts one priority above: in six calls 48 % of places are felt, with 0.8 36 %
TO_ZERO: Final = (0.9, 0.97)  # frictions from which on a finger's points are pulled to 0, in part and altogether
EXACT: Final = 2.0  # as stickiness: a point that gets 0
UNCERTAIN_FRAC: Final = 0.01  # of a mode's amplitude: map, gain and sensor together
STAY_FRAC: Final = 0.03  # of the mean curvature: keeps W where directions are nearly equal
COLD_TURN_RAD: Final = 2.4  # from mode to mode at the start: no pattern of signs is preferred
MISSED_JND: Final = 1.0  # more than this counts as limited
AT_LIMIT_FRAC: Final = 0.99
NEAR_FRAC: Final = 0.999  # of the square of a step: below it rounding decides nothing

RINGS: Final = 2
SPOKES: Final = 6


def solve_felt(
    shapes: Shapes,
    weights: list[float],
    curve: FrictionCurve,
    targets_um: ModeRow,
    limits_um: ModeRow,
    d_um: list[float],
    q_um: list[float],
    log_weights: list[float],
    stretches: list[float],
    priorities: list[int],
) -> tuple[list[float], bool]:
    """Move W (M,), given in its parts, to where the largest error is least; return each contact's RMS (N,), and
    `limited`.

    `shapes` (N, Q, M) are those at the points of each contact (`contact_shapes`), of these `weights` (Q,); `stretches`
    (N,) are by how much more amplitude each finger needs as it slides, `priorities` (N,) say whose errors come first.
    Where a contact is one point, still fingers get exactly 0, and the squares of the others' errors in um are least.
    `log_weights` (N,) are kept from call to call, from 0 on. Without a slipping finger W becomes 0. If W is 0, the
    search starts from all modes alike.
    """
    if not is_any_slippery(targets_um):
        for k in range(len(limits_um)):
            d_um[k] = q_um[k] = 0.0
        return [0.0] * len(targets_um), False
    is_cold = True
    for k in range(len(limits_um)):
        is_cold = is_cold and d_um[k] == 0.0 and q_um[k] == 0.0
    if is_cold:
        for k in range(len(limits_um)):
            start_um, turn_rad = min(limits_um[k], max(targets_um)), COLD_TURN_RAD * k
            d_um[k], q_um[k] = start_um * math.cos(turn_rad), start_um * math.sin(turn_rad)
    frictions = [curve.friction(targets_um[n] / stretches[n]) for n in range(len(targets_um))]
    errors_jnd, rms_um = descend(
        shapes,
        weights,
        list(targets_um),
        frictions,
        counted_jnd(frictions, priorities),
        stickiness(frictions) if len(weights) > 1 else [EXACT * (target_um == 0.0) for target_um in targets_um],
        stretches,
        curve.pieces,
        (curve.full_um, curve.floor_frac),
        limits_um,
        d_um,
        q_um,
        log_weights,
        COLD_ITERATIONS if is_cold else ITERATIONS,
        STAY_FRAC,
        UNCERTAIN_FRAC,
    )
    return rms_um, _is_limited(errors_jnd, limits_um, d_um, q_um)


def step_towards(
    before_d_um: list[float], before_q_um: list[float], d_um: list[float], q_um: list[float], most_um: float
) -> bool:
    """Shorten the way of W from before to at most `most_um` in any mode; return whether it was longer.

    Limits hold on the whole way, because they are discs; a pattern that begins at rest keeps its contrast.
    """
    largest_um, near_um2, is_near = 0.0, NEAR_FRAC * most_um * most_um, True
    for k in range(len(d_um)):  # mostly; a call of `hypot` takes ten times as long
        step_d_um, step_q_um = d_um[k] - before_d_um[k], q_um[k] - before_q_um[k]
        is_near = is_near and step_d_um * step_d_um + step_q_um * step_q_um < near_um2
    if is_near:
        return False
    for k in range(len(d_um)):
        largest_um = max(largest_um, math.hypot(d_um[k] - before_d_um[k], q_um[k] - before_q_um[k]))
    if largest_um <= most_um:
        return False
    share = most_um / largest_um
    for k in range(len(d_um)):
        d_um[k] = before_d_um[k] + share * (d_um[k] - before_d_um[k])
        q_um[k] = before_q_um[k] + share * (q_um[k] - before_q_um[k])
    return True


def is_any_slippery(targets_um: tuple[float, ...]) -> bool:
    """Return whether some finger's target is above 0."""
    is_any = False
    for target_um in targets_um:
        is_any = is_any or target_um > 0.0
    return is_any


def stickiness(frictions: list[float]) -> list[float]:
    """Return the share in which the points of each finger are pulled to 0, by the friction that is asked of it."""
    return [_between(friction, *TO_ZERO) for friction in frictions]


def counted_jnd(frictions: list[float], priorities: list[int]) -> list[float]:
    """Return as much of each finger's error as counts, in just noticeable differences, for the targets' frictions and
    the fingers' priorities.

    Of each priority in use a share of what counts one above. Within the highest, where there are lower ones, the
    stickiest finger counts in full, however slippery it is.
    """
    slipperiness = [1.0 - _between(friction, FIRST_IN_PART, FIRST) for friction in frictions]
    if priorities.count(priorities[0]) == len(priorities):
        return [MOST_SLIPPERY / more if more > 0.0 else math.inf for more in slipperiness]
    in_use = sorted(set(priorities), reverse=True)
    least = min([slipperiness[n] for n in range(len(frictions)) if priorities[n] == in_use[0]])
    counted = []
    for n in range(len(frictions)):
        if priorities[n] == in_use[0]:
            more = slipperiness[n] - least
            counted.append(MOST_SLIPPERY / more if more > 0.0 else math.inf)
        else:
            less = 1.0 - (1.0 - MOST_SLIPPERY) * slipperiness[n]
            counted.append(less * MOST_LOWER ** in_use.index(priorities[n]))
    return counted


def _between(friction: float, low: float, high: float) -> float:
    share = (friction - low) / (high - low)
    return 0.0 if share < 0.0 else (1.0 if share > 1.0 else share)


def _is_limited(errors_jnd: list[float], limits_um: ModeRow, d_um: list[float], q_um: list[float]) -> bool:
    """Whether some mode is at its limit while a finger feels that it misses its target."""
    misses = False
    for error_jnd in errors_jnd:
        misses = misses or abs(error_jnd) > MISSED_JND
    if not misses:
        return False
    for k in range(len(limits_um)):
        if d_um[k] * d_um[k] + q_um[k] * q_um[k] >= AT_LIMIT_FRAC * limits_um[k] * limits_um[k]:
            return True
    return False


def felt_points() -> Disc:
    """Return points of the unit disc, (dx, dy, weight) about its centre: Gauss's rule along the radius squared, the
    rings turned against each other. Friction needs more of them than an RMS: it is no polynomial."""
    points = []
    for ring in range(RINGS):
        node = (2 * ring - 1) / math.sqrt(3.0)  # of Gauss's rule of two nodes, -1 .. 1
        reach = math.sqrt((node + 1.0) / 2.0)
        for spoke in range(SPOKES):
            turn_rad = 2.0 * math.pi * (spoke + 0.5 * ring) / SPOKES
            weight = 1.0 / (RINGS * SPOKES)
            points.append((reach * math.cos(turn_rad), reach * math.sin(turn_rad), weight))
    return points
