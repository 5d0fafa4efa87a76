"""Two fingers on two modes, in closed forms: nearly every knot of nearly every frame.

Every number is an argument, or stands in a tuple of known length. Machine code keeps such numbers in registers, where
each entry of a row of any length is an object to be made and looked into.
"""

from __future__ import annotations

import math
from typing import Final

from .arithmetic import NOISE, Pair, Shapes2, clamped, within

Answer = tuple[float, float, bool]  # W of two modes, and what the function says of it

_CLEARLY_LESS: Final = 1.0 - 1e-6  # of |W|^2: no tie to look into
_CLEARLY_WORSE: Final = 1e-12  # of the targets' scale, squared: ten times what `solver_choice` takes for rounding
_MISSED: Final = 1e-9  # of a target: more than rounding


def hold_still(slipping: Pair, target: float, still: Pair, limits: Pair, previous: Pair, effort: float = 0.0) -> Answer:
    """`keep_zero` for a slipping finger and one that is still, on no common node: W, and whether it is limited.

    A `previous` of zeros says nothing. The same arithmetic as `solver_plane.slide_on_line`, without its loops; a test
    holds them together bit for bit. Shapes that are not finite give silence.
    """
    (x, y), (limit_x, limit_y) = still, limits
    if abs(y) >= abs(x) and 0.0 < abs(y) < math.inf:
        ux, uy = 1.0, -x / y
        slope = abs(uy)
        top = limit_y / slope if slope * limit_x > limit_y else limit_x
    elif 0.0 < abs(x) < math.inf:
        ux, uy = -y / x, 1.0
        slope = abs(ux)
        top = limit_x / slope if slope * limit_y > limit_x else limit_y
    else:
        return 0.0, 0.0, False
    first, second = slipping[0] * ux, slipping[1] * uy
    gain = first + second
    size = abs(gain)
    if not NOISE * (abs(first) + abs(second)) < size < math.inf:
        return 0.0, 0.0, False
    wanted = target / (size + effort * (ux * ux + uy * uy) / size) if effort > 0.0 else target / size
    t = wanted if wanted <= top else top
    lean = previous[0] * ux + previous[1] * uy
    if lean < 0.0 or (lean == 0.0 and gain < 0.0):
        t = -t
    w_x, w_y = within((t * ux, t * uy), limits)
    return w_x, w_y, not wanted <= top


def meeting(shapes: Shapes2, first: float, second: float) -> Answer:
    """The W that gives two fingers these amplitudes, and whether there is one: none where they see the modes alike.

    By elimination from the row that is larger in the first mode.
    """
    a, b, c, d = shapes
    size, other_size = max(abs(a), abs(b)), max(abs(c), abs(d))
    if not (size > 0.0 and other_size > 0.0):
        return 0.0, 0.0, False
    forward, backward = a / size * (d / other_size), c / other_size * (b / size)
    if not abs(forward - backward) > NOISE * (abs(forward) + abs(backward)):
        return 0.0, 0.0, False
    if abs(c) > abs(a):
        a, b, c, d, first, second = c, d, a, b, second, first
    ratio = c / a
    pivot = d - ratio * b
    if pivot == 0.0:  # underflow: the smaller row is subnormal
        return 0.0, 0.0, False
    y = (second - ratio * first) / pivot
    return (first - b * y) / a, y, True


def into_box(free: Pair, shapes: Shapes2, wanted: Pair, limits: Pair) -> Answer:
    """From the W that gives two fingers what is wanted to the best within the limits; and whether these bent it.

    The minimum lies on an edge that `free` violates: by convexity no other can hold it.
    """
    (x, y), (limit_x, limit_y) = free, limits
    a, b, c, d = shapes
    crosses_x, crosses_y = not abs(x) <= limit_x, not abs(y) <= limit_y
    if not (crosses_x or crosses_y):
        return x, y, False
    edge_x, edge_y = math.copysign(limit_x, x), math.copysign(limit_y, y)
    on_x = edge_x, _best_on_edge((b, a), (d, c), wanted, edge_x, limit_y)
    on_y = _best_on_edge((a, b), (c, d), wanted, edge_y, limit_x), edge_y
    if crosses_x and not (crosses_y and _excess(on_y, on_x, shapes, wanted) < 0.0):
        return on_x[0], on_x[1], True
    return on_y[0], on_y[1], True


def better_signs(shapes: Shapes2, targets: Pair, limits: Pair, *, is_in_range: bool) -> tuple[float, float, bool, bool]:
    """Of two slipping fingers' two patterns of signs the better W; whether it is limited; whether it is clearly better.

    What is unclear (they see the modes alike; errors or norms are close) is left to `solver_choice`. `is_in_range`:
    squares of shapes and targets are floats.
    """
    first, second = targets
    x, y, is_met = meeting(shapes, first, second)
    p, q, _ = meeting(shapes, first, -second)
    plus_fits = is_met and abs(x) <= limits[0] and abs(y) <= limits[1]
    minus_fits = is_met and abs(p) <= limits[0] and abs(q) <= limits[1]
    if plus_fits and minus_fits:
        one, other = x * x + y * y, p * p + q * q
        plus_fits, minus_fits = one < other * _CLEARLY_LESS, other < one * _CLEARLY_LESS
    elif is_met and is_in_range and not (plus_fits or minus_fits):
        return _better_at_limits(shapes, targets, limits, (x, y), (p, q))
    if plus_fits:
        return x, y, False, True
    return p, q, False, minus_fits


def _better_at_limits(
    shapes: Shapes2, targets: Pair, limits: Pair, plus: Pair, minus: Pair
) -> tuple[float, float, bool, bool]:
    """As `better_signs`, where neither pattern fits as it is."""
    first, second = targets
    x, y, _ = into_box(plus, shapes, targets, limits)
    p, q, _ = into_box(minus, shapes, (first, -second), limits)
    one, other = amplitudes(shapes, (x, y)), amplitudes(shapes, (p, q))
    excess = excess_error(other, one, targets)
    if excess < 0.0:
        x, y, one = p, q, other
    is_clear = abs(excess) > _CLEARLY_WORSE * (first * one[0] + second * one[1])
    return x, y, misses_either(one, targets), is_clear


def amplitudes(shapes: Shapes2, modal: Pair) -> Pair:
    """What two fingers get: |w_1|, |w_2|."""
    a, b, c, d = shapes
    x, y = modal
    return abs(a * x + b * y), abs(c * x + d * y)


def excess_error(one: Pair, other: Pair, targets: Pair) -> float:
    """Squared error of amplitudes above that of others, without the targets' squares: these may dwarf it."""
    (v, w), (u, t) = one, other
    return (v - u) * (v + u - 2.0 * targets[0]) + (w - t) * (w + t - 2.0 * targets[1])


def misses_either(given: Pair, targets: Pair) -> bool:
    """Some finger does not get its target, by more than rounding: `solver_choice.misses` of two."""
    first, second = targets
    return not (abs(given[0] - first) <= _MISSED * first and abs(given[1] - second) <= _MISSED * second)


def condition(shapes: Shapes2) -> float:
    """Of (a b; c d): the largest singular value squared over the determinant (Blinn, IEEE CG&A 16(2), 1996)."""
    a, b, c, d = shapes
    size = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
    determinant = abs(a * d - b * c)
    if size > 0.0 and not (determinant > 1e-100 and size < 1e100):
        a, b, c, d = a / size, b / size, c / size, d / size
        determinant = abs(a * d - b * c)
    if not determinant > 0.0:
        return math.inf
    one, other = (a + d) * (a + d) + (b - c) * (b - c), (a - d) * (a - d) + (b + c) * (b + c)
    largest = (math.sqrt(one) + math.sqrt(other)) / 2
    return max(largest * largest / determinant, 1.0)


def _best_on_edge(one: Pair, other: Pair, wanted: Pair, edge: float, limit: float) -> float:
    """The first mode's best amplitude while the second stands at `edge`."""
    (x, y), (u, v) = one, other
    weight = x * x + u * u
    pull = x * (wanted[0] - y * edge) + u * (wanted[1] - v * edge)
    return clamped(pull / weight, limit) if weight > 0.0 else 0.0


def _excess(one: Pair, other: Pair, shapes: Shapes2, wanted: Pair) -> float:
    """Squared error of W above that of another, signs given."""
    (x, y), (p, q) = one, other
    a, b, c, d = shapes
    first = (a * (x - p) + b * (y - q)) * (a * (x + p) + b * (y + q) - 2.0 * wanted[0])
    return first + (c * (x - p) + d * (y - q)) * (c * (x + p) + d * (y + q) - 2.0 * wanted[1])
