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
from array import array
from typing import Final

from ...values import FloatArray
from ..friction import FrictionCurve
from ..phasors import Phasors
from ..plate.contact import Disc, Shapes
from .felt_descent import descend

ITERATIONS: Final = 7  # of a call
FIRST_IN_PART: Final = 0.7  # friction from which on errors count in full where not all can be had, in part
FIRST: Final = 0.9  # and altogether
MOST_SLIPPERY: Final = 0.9  # of a just noticeable difference: as much of a slippery finger's error counts
MOST_LOWER: Final = 0.7  # of what counts one priority above: in six calls 48 % of places are felt, with 0.8 36 %
TO_ZERO: Final = (0.9, 0.97)  # frictions from which on a finger's points are pulled to 0, in part and altogether
STAY_FRAC: Final = 0.03  # of the mean curvature: keeps W where directions are nearly equal
MISSED_JND: Final = 1.0
RINGS: Final = 2
SPOKES: Final = 6


def solve_felt(
    shapes: Shapes,
    disc: FloatArray,
    curve: FrictionCurve,
    targets_um: list[float],
    limits_um: FloatArray,
    modal_um: Phasors,
    log_weights: list[float],
    speed_gains: list[float],
    priorities: list[int],
    most_step_um: float = math.inf,
) -> tuple[Phasors, list[float], bool]:
    """Return W (M,), moved to where the largest error is least, each contact's RMS (N,), and `limited`.

    `shapes` (N, Q, M) are those at the points of each contact, of a `disc` (Q, 3) (`contact_shapes`); `speed_gains`
    (N,) are the gains of the amplitude that each finger needs as it slides, `priorities` (N,) say whose errors come
    first. Where a contact is one point, still fingers get exactly 0, and the squares of the others' errors in um are
    least. `log_weights` (N,) are kept from call to call, from 0 on. Without a slipping finger W becomes 0. No mode
    moves by more than `most_step_um`: a pattern that begins at rest keeps its contrast.
    """
    fingers = len(targets_um)
    if not is_any_slippery(targets_um):
        return (0j,) * len(modal_um), [0.0] * fingers, False
    table = finger_table(curve, targets_um, log_weights, speed_gains, priorities)
    moved_um, limited = descend(
        shapes, disc, table, curve.table, limits_um, modal_um, ITERATIONS, STAY_FRAC, most_step_um
    )
    found = table.tolist()
    log_weights[:] = found[5 * fingers : 6 * fingers]
    return moved_um, found[7 * fingers :], limited


def finger_table(
    curve: FrictionCurve,
    targets_um: list[float],
    log_weights: list[float],
    speed_gains: list[float],
    priorities: list[int],
) -> array[float]:
    """Return what `descend` takes of fingers (8, N), see there."""
    frictions = [curve.friction(targets_um[n] / speed_gains[n]) for n in range(len(targets_um))]
    counted, answers = counted_jnd(frictions, priorities), [0.0] * (2 * len(targets_um))
    return array("d", targets_um + frictions + counted + stickiness(frictions) + speed_gains + log_weights + answers)


def is_any_slippery(targets_um: list[float]) -> bool:
    """Return whether some finger's target is above 0."""
    is_any = False
    for target_um in targets_um:
        is_any = is_any or target_um > 0.0
    return is_any


def stickiness(frictions: list[float]) -> list[float]:
    """Return the share in which each finger's points are pulled to 0."""
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
    return min(max((friction - low) / (high - low), 0.0), 1.0)


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
