"""The solver's shared arithmetic: what is noise, what is out of range, and scaling it back in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

Row = tuple[float, ...]
Pair = tuple[float, float]
Shapes2 = tuple[float, float, float, float]  # of two modes at the first finger, then at the second

NOISE: Final = 8 * 2.0**-52  # a sum of products below this share of its terms is rounding, not signal
LAST_BIT: Final = 1.0 - 2.0**-51  # a root of squares errs by a last bit, as does a library's hypot: two are left
_REACH_CAP: Final = 1e30  # a target so many times out of reach acts like any farther one
_LEAST_SQUARE: Final = 1e-200  # less, and more than its inverse: squares lose digits at the ends of the floats' range
_EFFORT_CAP: Final = 1e18  # beside an effort so many times theirs the rows' own squares are below rounding


def normalised(
    size: float, targets: Sequence[float], limits: Sequence[float], effort: float
) -> tuple[list[float], tuple[float, ...], float, float]:
    """Targets, limits and effort for rows divided by `size` and a largest limit of 1, and what to multiply W by.

    A target that is out of reach by more than `_REACH_CAP` is brought to it, the others and the effort in proportion;
    so is an effort above `_EFFORT_CAP`. The solution is the same to rounding.
    """
    reach = max(limits) if max(limits) < math.inf else 1.0
    peak = max(targets)
    scaled_peak = peak / size / reach
    scaled_effort = effort / size / size
    if not scaled_peak <= _REACH_CAP:
        scaled_peak = _REACH_CAP
        scaled_effort = effort / size * (_REACH_CAP * reach / peak)
    if not scaled_effort <= _EFFORT_CAP:
        scaled_peak *= _EFFORT_CAP / scaled_effort if scaled_effort < math.inf else 0.0
        scaled_effort = _EFFORT_CAP
    return (
        [target / peak * scaled_peak for target in targets],
        tuple([limit / reach for limit in limits]),
        scaled_effort,
        reach,
    )


def within(modal: Pair, limits: Pair) -> Pair:
    """Shaves off what rounding left beyond a limit."""
    return clamped(modal[0], limits[0]), clamped(modal[1], limits[1])


def clamped(value: float, limit: float) -> float:
    if -limit <= value <= limit:
        return value
    return math.copysign(limit, value) if value == value else 0.0


def cross_terms(one: Row, other: Row) -> Pair:
    """x1 y2 and x2 y1 of two rows, each scaled to a largest entry of 1."""
    size, other_size = max(abs(one[0]), abs(one[1])), max(abs(other[0]), abs(other[1]))
    if not (size > 0.0 and other_size > 0.0):
        return 0.0, 0.0
    x, y = one[0] / size, one[1] / size
    other_x, other_y = other[0] / other_size, other[1] / other_size
    return x * other_y, other_x * y


def length(x: float, y: float) -> float:
    """hypot(x, y), in machine code without a call of Python where the squares are well within range."""
    square = x * x + y * y
    if _LEAST_SQUARE < square < 1.0 / _LEAST_SQUARE:
        return math.sqrt(square)
    return math.hypot(x, y)


def dot(one: Sequence[float], other: Sequence[float]) -> float:
    return sum([u * v for u, v in zip(one, other, strict=True)])
