"""From what the plate does to what it should do, for two fingers on two modes: as much of the way as no finger feels.

X = Re(W W^H) goes in a straight line (`core.solver.phase`), and so do all squares. Phasors are pairs of floats here:
this is asked many times for one knot, and complex numbers would cost more than their arithmetic.
"""

from __future__ import annotations

import math
from typing import Final

from .arithmetic import LAST_BIT, Pair, Shapes2, length

Phasors2 = tuple[float, float, float, float]  # of two modes or two fingers: real, imaginary, real, imaginary
Squares = tuple[float, float, float]  # X: |W_1|^2, |W_2|^2 and Re(W_1 W_2*)

_HALVINGS: Final = 10


def eased(
    shapes: Shapes2, limits: Pair, wanted: Phasors2, previous: Phasors2, keep: float, unfelt_um: Pair
) -> Phasors2:
    """The farthest phasors on the way from `previous` to `wanted` that no finger feels being left for.

    Midway on the chord from `previous` no finger may have less than `keep` of what it has at either end, but for what
    is `unfelt_um`.
    """
    wanted = nearer_hand(wanted, limits, previous)
    was = given(shapes, previous)
    was_um = length(was[0], was[1]), length(was[2], was[3])
    if not _sags(was, was_um, given(shapes, wanted), keep, unfelt_um):
        return wanted
    begin, end = squares(previous), squares(wanted)
    low, high, farthest = 0.0, 1.0, wanted
    for _ in range(_HALVINGS):
        share = (low + high) / 2
        phasors = nearer_hand(between(begin, end, share), limits, previous)
        if _sags(was, was_um, given(shapes, phasors), keep, unfelt_um):
            high = share
        else:
            low, farthest = share, phasors
    return farthest


def _sags(was: Phasors2, was_um: Pair, now: Phasors2, keep: float, unfelt_um: Pair) -> bool:
    """Midway on the chord some finger gets clearly less than at either end."""
    a, b, c, d = was
    p, q, r, s = now
    least_um = min(was_um[0], length(p, q))
    if length(a + p, b + q) / 2 < keep * least_um - unfelt_um[0]:
        return True
    least_um = min(was_um[1], length(r, s))
    return length(c + r, d + s) / 2 < keep * least_um - unfelt_um[1]


def given(shapes: Shapes2, modal: Phasors2) -> Phasors2:
    """The phasors that modal phasors give the fingers."""
    one_x, one_y, other_x, other_y = shapes
    a, b, c, d = modal
    return one_x * a + one_y * c, one_x * b + one_y * d, other_x * a + other_y * c, other_x * b + other_y * d


def squares(modal: Phasors2) -> Squares:
    """X of phasors."""
    a, b, c, d = modal
    return a * a + b * b, c * c + d * d, a * c + b * d


def between(begin: Squares, end: Squares, share: float) -> Phasors2:
    """Phasors of the X so far on the way from one to another, the first of them real."""
    one = math.sqrt(begin[0] + share * (end[0] - begin[0]))
    other = math.sqrt(begin[1] + share * (end[1] - begin[1]))
    product = begin[2] + share * (end[2] - begin[2])
    if one * other == 0.0:
        return one, 0.0, other, 0.0
    cos = min(max(product / (one * other), -1.0), 1.0)
    return one, 0.0, other * cos, other * math.sqrt((1.0 - cos) * (1.0 + cos))


def nearer_hand(modal: Phasors2, limits: Pair, previous: Phasors2) -> Phasors2:
    """A solution or its mirror image, at the common phase that comes nearest to the present phasors.

    Within the limits to the last bit. The same as `solver_turn.nearer_hand`; a test holds them together.
    """
    a, b, c, d = modal
    p, q, r, s = previous
    # The inner product with `previous`: its phase is how far `previous` is ahead. Then that of the mirror image.
    lean, lean_j = a * p + b * q + (c * r + d * s), a * q - b * p + (c * s - d * r)
    mirrored, mirrored_j = a * p - b * q + (c * r - d * s), a * q + b * p + (c * s + d * r)
    size, mirrored_size = length(lean, lean_j), length(mirrored, mirrored_j)
    if mirrored_size > size:
        b, d, lean, lean_j, size = -b, -d, mirrored, mirrored_j, mirrored_size
    cos, sin = (lean / size, lean_j / size) if 0.0 < size < math.inf else (1.0, 0.0)
    if sin == b == d == 0.0 and abs(a) <= limits[0] and abs(c) <= limits[1]:
        return a * cos, 0.0, c * cos, 0.0
    a, b, c, d = a * cos - b * sin, a * sin + b * cos, c * cos - d * sin, c * sin + d * cos
    shave = 2.0**-53
    while length(a, b) > limits[0] * LAST_BIT or length(c, d) > limits[1] * LAST_BIT:
        kept = 1.0 - shave
        a, b, c, d = a * kept, b * kept, c * kept, d * kept
        shave *= 2.0
    return a, b, c, d
