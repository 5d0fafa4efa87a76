"""The step from the present phasors to new ones: the nearest equivalent, and as much of the way as no finger feels.

Phasors are flat tuples of floats here, (real, imaginary) mode by mode: complex numbers cost more than their arithmetic.
"""

from __future__ import annotations

import math
from typing import Final

from ...phasors import ModeRow, Pair, Shapes2, magnitude

Phasors2 = tuple[float, float, float, float]  # of two modes or two fingers: real, imaginary, real, imaginary
Squares = tuple[float, float, float]  # X: |W_1|^2, |W_2|^2 and Re(W_1 W_2*)

_LAST_BIT: Final = 1.0 - 2.0**-51  # a root of squares errs by a last bit, as does a library's hypot: two are left
_HALVINGS: Final = 10


def nearer_hand(modal: ModeRow, limits: ModeRow, previous: ModeRow) -> ModeRow:
    """A solution or its mirror image, turned by the common phase that is nearest to the present phasors.

    No finger can distinguish these. Flat phasors of any number of modes, within the limits to the last bit: all are
    scaled together by what rounding left beyond one, so still fingers stay still.
    """
    lean = lean_j = mirrored = mirrored_j = 0.0
    is_real = True
    for k in range(len(limits)):
        a, b, p, q = modal[2 * k], modal[2 * k + 1], previous[2 * k], previous[2 * k + 1]
        # Inner products with `previous`: their phase is how far `previous` is ahead.
        lean += a * p + b * q
        lean_j += a * q - b * p
        mirrored += a * p - b * q
        mirrored_j += a * q + b * p
        is_real = is_real and b == 0.0 and abs(a) <= limits[k]
    size, mirrored_size = magnitude(lean, lean_j), magnitude(mirrored, mirrored_j)
    hand = 1.0
    if mirrored_size > size:
        hand, lean, lean_j, size = -1.0, mirrored, mirrored_j, mirrored_size
    cos, sin = (lean / size, lean_j / size) if 0.0 < size < math.inf else (1.0, 0.0)
    turned: list[float] = []
    if is_real and sin == 0.0:
        for k in range(len(limits)):
            turned.append(modal[2 * k] * cos)
            turned.append(0.0)
        return tuple(turned)
    for k in range(len(limits)):
        a, b = modal[2 * k], hand * modal[2 * k + 1]
        turned.append(a * cos - b * sin)
        turned.append(a * sin + b * cos)
    shave = 2.0**-53
    while _beyond(turned, limits) > 0:
        turned = [part * (1.0 - shave) for part in turned]
        shave *= 2.0
    return tuple(turned)


def _beyond(modal: list[float], limits: ModeRow) -> int:
    """How many modes are beyond their limits."""
    count = 0
    for k in range(len(limits)):
        count += magnitude(modal[2 * k], modal[2 * k + 1]) > limits[k] * _LAST_BIT
    return count


# --- two fingers on two modes ---------------------------------------------------------------------------------------


def eased(
    shapes: Shapes2, limits: Pair, wanted: Phasors2, previous: Phasors2, keep: float, unfelt_um: Pair
) -> Phasors2:
    """The farthest phasors on the way from `previous` to `wanted` during which no finger feels a dip.

    X = Re(W W^H) follows a straight line, and so do all squares. Midway on the chord from `previous` no finger may have
    less than `keep` of what it has at either end, by more than `unfelt_um`.
    """
    wanted = _nearer_hand(wanted, limits, previous)
    was = given(shapes, previous)
    was_um = magnitude(was[0], was[1]), magnitude(was[2], was[3])
    if not _sags(was, was_um, given(shapes, wanted), keep, unfelt_um):
        return wanted
    begin, end = squares(previous), squares(wanted)
    low, high, farthest = 0.0, 1.0, wanted
    for _ in range(_HALVINGS):
        share = (low + high) / 2
        phasors = _nearer_hand(between(begin, end, share), limits, previous)
        if _sags(was, was_um, given(shapes, phasors), keep, unfelt_um):
            high = share
        else:
            low, farthest = share, phasors
    return farthest


def _nearer_hand(modal: Phasors2, limits: Pair, previous: Phasors2) -> Phasors2:
    turned = nearer_hand(modal, limits, previous)
    return turned[0], turned[1], turned[2], turned[3]


def _sags(was: Phasors2, was_um: Pair, now: Phasors2, keep: float, unfelt_um: Pair) -> bool:
    """Midway on the chord some finger gets clearly less than at either end."""
    a, b, c, d = was
    p, q, r, s = now
    least_um = min(was_um[0], magnitude(p, q))
    if magnitude(a + p, b + q) / 2 < keep * least_um - unfelt_um[0]:
        return True
    least_um = min(was_um[1], magnitude(r, s))
    return magnitude(c + r, d + s) / 2 < keep * least_um - unfelt_um[1]


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
    """Phasors of the X at this share of the way from one X to another; the first of them is real."""
    one = math.sqrt(begin[0] + share * (end[0] - begin[0]))
    other = math.sqrt(begin[1] + share * (end[1] - begin[1]))
    product = begin[2] + share * (end[2] - begin[2])
    if one * other == 0.0:
        return one, 0.0, other, 0.0
    cos = min(max(product / (one * other), -1.0), 1.0)
    return one, 0.0, other * cos, other * math.sqrt((1.0 - cos) * (1.0 + cos))
