"""The entries to all ways to solve for points, each by the quickest that applies, and that of nearly every knot.

One or two fingers on two modes have a closed form. There every number is an argument or an entry of a tuple of fixed
length: compiled code keeps these in registers, where each entry of a tuple of any length is an object to create and
unbox. What a closed form cannot decide (two slipping fingers with parallel rows, squares beyond the range of floats, a
still finger on a common node) is left to the other ways.
"""

from __future__ import annotations

import math
from typing import Final

from ...phasors import (
    EQUAL_ERROR,
    EQUAL_NORM,
    MISSED,
    NOISE,
    SAFE,
    ModeRow,
    ModeRows,
    Pair,
    Shapes2,
    clamped,
    unscaled,
    within,
)
from .descent import serve_many
from .line import solve_line
from .sign_patterns import pose

Solved = tuple[float, float, bool]  # W of two modes, and whether a limit keeps a finger from its target
_Answer = tuple[float, float, bool, bool]  # the same, and whether the closed form applies

_NO_ANSWER: Final = (0.0, 0.0, False, False)


def solve_fast(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None
) -> tuple[ModeRow, bool]:
    """The touch path's, on plain floats for callers that have checked their input: modal amplitudes in um, and
    `limited`. More fingers or modes than closed forms take descend (`descent`), several slipping ones from `previous`.

    Whatever phi holds, the result is finite and within the limits; a phi that is not finite gives silence.
    """
    direct = _direct(rows, targets, limits, previous)
    if direct is not None:
        return direct
    d_um, q_um = [0.0] * len(limits), [0.0] * len(limits)
    slipping = sum([target > 0.0 for target in targets])
    if previous is not None and slipping > 1:  # one has no sign to keep: from rest it ends at the least amplitudes
        for mode in range(len(limits)):
            d_um[mode] = clamped(previous[mode], limits[mode])
    limited = serve_many(rows, targets, limits, d_um, q_um, is_real=True)
    return _signed(tuple(d_um), previous), limited


def solve_exactly(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None
) -> tuple[ModeRow, bool]:
    """As `solve_fast`, but with the best of all sign patterns however long they take: `solve`."""
    direct = _direct(rows, targets, limits, previous)
    return solve_general(rows, targets, limits, previous) if direct is None else direct


def solve_general(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None
) -> tuple[ModeRow, bool]:
    """As `solve_exactly`, by the general path alone."""
    problem = pose(rows, targets, limits)
    if problem is None:
        return (0.0,) * len(limits), False
    modal, is_limited = problem.best(previous)
    return unscaled(problem.reach, modal, limits), is_limited


def _direct(rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None) -> tuple[ModeRow, bool] | None:
    """Closed forms; None where there is none."""
    if len(limits) == 2 and 1 <= len(rows) <= 2:
        box = limits[0], limits[1]
        near = (0.0, 0.0) if previous is None else (previous[0], previous[1])
        one, first = rows[0], targets[0]  # by index: compiled code unpacks rows of any length through an iterator
        a, b = one[0], one[1]
        if len(rows) == 1:
            x, y, limited, is_solved = serve_one((a, b), first, box, near) if first > 0.0 else (0.0, 0.0, False, True)
            if is_solved:
                return (x, y), limited
        else:
            other, second = rows[1], targets[1]
            c, d = other[0], other[1]
            if second == 0.0 < first:
                if c == 0.0 and d == 0.0:  # on a node of both modes: still, whatever they do
                    return _direct(rows[:1], targets[:1], limits, previous)
                x, y, limited = hold_still((a, b), first, (c, d), box, near)
                return (x, y), limited
            if first == 0.0 < second:
                if a == 0.0 and b == 0.0:
                    return _direct(rows[1:], targets[1:], limits, previous)
                x, y, limited = hold_still((c, d), second, (a, b), box, near)
                return (x, y), limited
            if first > 0.0 < second:
                x, y, limited, is_solved = serve_both((a, b, c, d), (first, second), box, near)
                if is_solved:
                    return (x, y), limited
    line = solve_line(rows, targets, limits)
    if line is None:
        return None
    modal, limited = line
    return _signed(modal, previous), limited


def _signed(modal: ModeRow, previous: ModeRow | None) -> ModeRow:
    """Return the nearer one to `previous` of W and -W, which no finger can distinguish."""
    lean = 0.0
    if previous is not None:
        for mode in range(len(modal)):
            lean += modal[mode] * clamped(previous[mode], SAFE)
    return modal if lean >= 0.0 else tuple([-w for w in modal])


def serve_one(row: Pair, target: float, limits: Pair, previous: Pair) -> _Answer:
    """The least |W| that gives one finger its target: along its row, turning onto the limit that it meets first."""
    x, y = row
    size = max(abs(x), abs(y))
    if not (1.0 / SAFE < size < SAFE and target < SAFE):
        return _NO_ANSWER
    x, y = x / size, y / size
    square = x * x + y * y
    if not square >= 1.0:  # one of them is no number: `max` heeds the first alone
        return _NO_ANSWER
    t = target / (size * square)
    limit_x, limit_y = limits
    w_x, w_y = t * x, t * y
    is_bent = not (abs(w_x) <= limit_x and abs(w_y) <= limit_y)
    if is_bent:
        if limit_x * abs(y) < limit_y * abs(x):
            w_x = math.copysign(limit_x, target * x)
            w_y = clamped((target / size - w_x * x) / y, limit_y) if abs(y) > NOISE else 0.0
        else:
            w_y = math.copysign(limit_y, target * y)
            w_x = clamped((target / size - w_y * y) / x, limit_x) if abs(x) > NOISE else 0.0
    limited = is_bent and not abs(abs(row[0] * w_x + row[1] * w_y) - target) <= MISSED * target
    w_x, w_y = within(_turned((w_x, w_y), previous), limits)
    return w_x, w_y, limited, True


def hold_still(slipping: Pair, target: float, still: Pair, limits: Pair, previous: Pair) -> Solved:
    """W for a slipping finger and a still one that is on no common node.

    W lies on the line (phi_Y, -phi_X) of the still finger (paper, section IV.B), limited along it, on the side of
    `previous`. Zeros in `previous` leave the sign free. Shapes that are not finite give silence.
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
    wanted = target / size
    t = wanted if wanted <= top else top
    lean = previous[0] * ux + previous[1] * uy
    if lean < 0.0 or (lean == 0.0 and gain < 0.0):
        t = -t
    w_x, w_y = within((t * ux, t * uy), limits)
    return w_x, w_y, not wanted <= top


def serve_both(shapes: Shapes2, targets: Pair, limits: Pair, previous: Pair) -> _Answer:
    """The better of the two sign patterns of two slipping fingers: least error, then least |W|, then nearest."""
    if not in_range(shapes, targets):
        return _NO_ANSWER
    first, second = targets
    x, y, is_met = meeting(shapes, first, second)
    p, q, _ = meeting(shapes, first, -second)
    if not is_met:
        return _NO_ANSWER
    x, y, is_bent = into_box((x, y), shapes, (first, second), limits)
    p, q, other_is_bent = into_box((p, q), shapes, (first, -second), limits)
    got, other_got = amplitudes(shapes, (x, y)), amplitudes(shapes, (p, q))
    excess = excess_error(other_got, got, targets)
    best = other_got if excess < 0.0 else got
    takes_other = excess < 0.0
    if abs(excess) <= EQUAL_ERROR * (first * best[0] + second * best[1]):
        takes_other = _is_better_tie((p, q), (x, y), previous)
    if takes_other:
        x, y, is_bent, got = p, q, other_is_bent, other_got
    x, y = within(_turned((x, y), previous), limits)
    return x, y, is_bent and misses_either(got, targets), True


def _is_better_tie(one: Pair, other: Pair, previous: Pair) -> bool:
    """Of two W that serve alike, whether `one` is clearly smaller, or about as small and nearer `previous`."""
    square, other_square = one[0] * one[0] + one[1] * one[1], other[0] * other[0] + other[1] * other[1]
    if square > other_square * (1.0 + EQUAL_NORM):
        return False
    if other_square > square * (1.0 + EQUAL_NORM):
        return True
    return _distance(_turned(one, previous), previous) < _distance(_turned(other, previous), previous)


def _turned(modal: Pair, previous: Pair) -> Pair:
    """W or -W, which no finger can distinguish: the one nearer `previous`."""
    if modal[0] * previous[0] + modal[1] * previous[1] < 0.0:
        return -modal[0], -modal[1]
    return modal


def _distance(one: Pair, other: Pair) -> float:
    x, y = one[0] - other[0], one[1] - other[1]
    return x * x + y * y


def in_range(shapes: Shapes2, targets: Pair) -> bool:
    """Squares of shapes and targets are floats."""
    a, b, c, d = shapes
    size = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
    return 1.0 / SAFE < size < SAFE and max(targets[0], targets[1]) < SAFE


def meeting(shapes: Shapes2, first: float, second: float) -> Solved:
    """The W that gives two fingers these amplitudes, and whether there is one: none where their rows are parallel.

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


def into_box(free: Pair, shapes: Shapes2, wanted: Pair, limits: Pair) -> Solved:
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


def _best_on_edge(one: Pair, other: Pair, wanted: Pair, edge: float, limit: float) -> float:
    """The first mode's best amplitude while the second is at `edge`."""
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


def amplitudes(shapes: Shapes2, modal: Pair) -> Pair:
    """Amplitudes of two fingers: |w_1|, |w_2|."""
    a, b, c, d = shapes
    x, y = modal
    return abs(a * x + b * y), abs(c * x + d * y)


def excess_error(one: Pair, other: Pair, targets: Pair) -> float:
    """Squared error of amplitudes above that of others, without the targets' squares: these may dwarf it."""
    (v, w), (u, t) = one, other
    return (v - u) * (v + u - 2.0 * targets[0]) + (w - t) * (w + t - 2.0 * targets[1])


def misses_either(got: Pair, targets: Pair) -> bool:
    """Some finger does not get its target, by more than rounding."""
    first, second = targets
    return not (abs(got[0] - first) <= MISSED * first and abs(got[1] - second) <= MISSED * second)


def condition(shapes: Shapes2) -> float:
    """Condition of (a b; c d): the largest singular value squared over the determinant (Blinn, IEEE CG&A 16(2),
    1996)."""
    a, b, c, d = shapes
    size = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
    determinant = abs(a * d - b * c)
    if size > 0.0 and not (determinant > 1.0 / SAFE and size < SAFE):
        a, b, c, d = a / size, b / size, c / size, d / size
        determinant = abs(a * d - b * c)
    if not determinant > 0.0:
        return math.inf
    one, other = (a + d) * (a + d) + (b - c) * (b - c), (a - d) * (a - d) + (b + c) * (b + c)
    largest = (math.sqrt(one) + math.sqrt(other)) / 2
    return max(largest * largest / determinant, 1.0)
