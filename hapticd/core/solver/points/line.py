"""Still fingers that leave one direction of modal amplitudes, W = t u: the best t in closed form, on plain floats.

M - 1 independent still fingers on M modes leave one direction: two on three modes, one on two. Every slipping finger
then has the sign of its gain phi_i u, so there is one sign pattern, and the limits are an interval of t. Nearly
dependent still fingers, or numbers whose squares leave the range of floats, are left to `general`.
"""

from __future__ import annotations

import math

from ...phasors import MISSED, NOISE, SAFE, ModeRow, ModeRows, clamped
from ...small_matrices import Vector, complement


def solve_line(rows: ModeRows, targets: ModeRow, limits: ModeRow) -> tuple[ModeRow, bool] | None:
    """`general.solve_fast` without `previous`; None where the still fingers leave no single direction."""
    still: list[Vector] = []
    for finger in range(len(rows)):
        size = _largest(rows[finger])
        if not size < SAFE or (0.0 < size < 1.0 / SAFE) or not targets[finger] < SAFE:
            return None
        if targets[finger] == 0.0 < size:
            still.append([shape / size for shape in rows[finger]])
    modes = len(limits)
    if len(still) != modes - 1 or not 1.0 / SAFE < min(limits) <= max(limits) < SAFE:
        return None
    basis = complement(still, modes)
    return None if basis is None else _served(rows, targets, limits, basis[0])


def _served(rows: ModeRows, targets: ModeRow, limits: ModeRow, along: Vector) -> tuple[ModeRow, bool]:
    """Least squares along a line, up to where it meets the first limit."""
    gains: Vector = []
    square = pull = 0.0
    for finger in range(len(rows)):
        row, target = rows[finger], targets[finger]
        gain = _gain(row, along) if target > 0.0 else 0.0
        gains.append(gain)
        square += gain * gain
        pull += gain * target
    if square == 0.0:
        return (0.0,) * len(limits), False
    top = math.inf
    for mode in range(len(limits)):
        share = abs(along[mode])
        if share > NOISE:
            top = min(top, limits[mode] / share)
    best = pull / square
    t = min(best, top)
    limited = False
    if best > top:
        for finger in range(len(gains)):
            target = targets[finger]
            limited = limited or not abs(t * gains[finger] - target) <= MISSED * target
    return tuple([clamped(t * along[mode], limits[mode]) for mode in range(len(limits))]), limited


def _gain(row: ModeRow, along: Vector) -> float:
    """|phi_i u|; 0 where it is rounding."""
    gain = terms = 0.0
    for mode in range(len(along)):
        product = row[mode] * along[mode]
        gain += product
        terms += abs(product)
    return abs(gain) if abs(gain) > NOISE * terms else 0.0


def _largest(row: ModeRow) -> float:
    """The largest magnitude; NaN counts as infinite."""
    largest = 0.0
    for value in row:
        if not abs(value) <= largest:
            largest = abs(value) if value == value else math.inf
    return largest
