"""Two modes and no still finger: least squares in the box |W_k| <= limit_k, for every sign pattern.

The minimum lies inside the box, or on an edge that the unconstrained minimum violates (by convexity no other edge can
hold it). Any number of fingers; work grows with the square of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .arithmetic import Pair, Row, Shapes2, clamped, dot, normalised, within
from .candidates import Candidate, candidate, choose, leans_away, misses
from .pair import better_signs, into_box, meeting

_RANK_NOISE: Final = 1e-13  # a column's part across the other, after subtracting a projection that is good to some ulps
_HUGE: Final = 1e100  # beyond this, and below its inverse, squares would leave the range of floats


def fill_box(
    rows: Sequence[Row],
    targets: Sequence[float],
    limits: Pair,
    previous: Row | None,
    effort: float,
    hysteresis: float,
) -> tuple[Row, bool]:
    """No finger is still: every sign pattern that the plane allows, solved and compared."""
    size = max([max(abs(row[0]), abs(row[1])) for row in rows])
    if not 0.0 < size < math.inf:
        return (0.0, 0.0), False
    is_in_range = 1.0 / _HUGE < size < _HUGE and max(targets) < _HUGE and effort < _HUGE
    if len(rows) == 2 and effort == 0.0 and hysteresis == 0.0:
        pair = targets[0], targets[1]
        x, y, limited, is_clear = better_signs(shapes_of(rows), pair, limits, is_in_range=is_in_range)
        if is_clear:
            turns = previous is not None and leans_away((x, y), previous)
            return within((-x, -y) if turns else (x, y), limits), limited
    reach = 1.0
    box: tuple[float, ...] = limits
    if not is_in_range:
        rows = [(row[0] / size, row[1] / size) for row in rows]
        targets, box, effort, reach = normalised(size, targets, limits, effort)
        previous = None if previous is None else tuple([w / reach for w in previous])
    candidates: list[Candidate] = []
    for signs in sign_patterns(rows):
        wanted = [sign * target for sign, target in zip(signs, targets, strict=True)]
        modal, clamped = box_least_squares(rows, wanted, (box[0], box[1]), effort)
        candidates.append(candidate(modal, rows, clamped))
    chosen = choose(candidates, targets, previous, effort, hysteresis)
    limited = chosen.clamped and misses(chosen.amplitudes, targets)
    return within((chosen.modal[0] * reach, chosen.modal[1] * reach), limits), limited


def sign_patterns(rows: Sequence[Row]) -> list[tuple[float, ...]]:
    """The signs that the fingers' amplitudes can have together, up to a common one: at most one pattern per finger.

    Each finger's amplitude changes sign across one line through the origin; n lines cut the plane into 2 n sectors.
    """
    if len(rows) == 1:
        return [(1.0,)]
    if len(rows) == 2:
        return [(1.0, 1.0), (1.0, -1.0)]
    angles = sorted([math.atan2(x, -y) % math.pi for x, y in rows])
    patterns: dict[tuple[float, ...], None] = {}
    for angle, following in zip(angles, [*angles[1:], angles[0] + math.pi], strict=True):
        middle = (angle + following) / 2
        toward_x, toward_y = math.cos(middle), math.sin(middle)
        signs = [1.0 if x * toward_x + y * toward_y >= 0.0 else -1.0 for x, y in rows]
        patterns[tuple([sign * signs[0] for sign in signs])] = None
    return list(patterns)


def box_least_squares(rows: Sequence[Row], wanted: Sequence[float], limits: Pair, effort: float) -> tuple[Pair, bool]:
    """The W in the box with least sum (row . W - wanted)^2 + effort |W|^2, of those the least |W|^2; was it clamped?"""
    if len(rows) == 1:
        return least_norm(rows[0], wanted[0], limits, effort)
    if len(rows) == 2 and effort == 0.0:
        shapes = shapes_of(rows)
        x, y, is_met = meeting(shapes, wanted[0], wanted[1])
        if not is_met:
            return _least_norm_of_parallel(rows, wanted, limits, effort)
        x, y, is_bent = into_box((x, y), shapes, (wanted[0], wanted[1]), limits)
        return (x, y), is_bent
    free = _tall_solution(rows, wanted, effort)
    if free is None:
        return _least_norm_of_parallel(rows, wanted, limits, effort)
    (x, y), (limit_x, limit_y) = free, limits
    if abs(x) <= limit_x and abs(y) <= limit_y:
        return free, False
    edges: list[Pair] = []
    if not abs(x) <= limit_x:
        edge = math.copysign(limit_x, x)
        edges.append((edge, _best_on_edge([(v, u) for u, v in rows], wanted, edge, limit_y, effort)))
    if not abs(y) <= limit_y:
        edge = math.copysign(limit_y, y)
        edges.append((_best_on_edge(rows, wanted, edge, limit_x, effort), edge))
    if len(edges) == 2 and _excess(edges[1], edges[0], rows, wanted, effort) < 0.0:
        return edges[1], True
    return edges[0], True


def least_norm(row: Row, wanted: float, limits: Pair, effort: float = 0.0) -> tuple[Pair, bool]:
    """The least |W| that gives one finger its amplitude: along its row (not 0), turning onto an edge it meets."""
    x, y = row
    size = max(abs(x), abs(y))
    x, y = x / size, y / size
    t = wanted / (size * (x * x + y * y) + effort / size)
    (limit_x, limit_y) = limits
    if abs(t * x) <= limit_x and abs(t * y) <= limit_y:
        return (t * x, t * y), False
    if limit_x * abs(y) < limit_y * abs(x):
        edge = math.copysign(limit_x, wanted * x)
        rest = (wanted / size - edge * x) / (y + effort / size / size / y) if y != 0.0 else 0.0
        return (edge, clamped(rest, limit_y)), True
    edge = math.copysign(limit_y, wanted * y)
    rest = (wanted / size - edge * y) / (x + effort / size / size / x) if x != 0.0 else 0.0
    return (clamped(rest, limit_x), edge), True


def _least_norm_of_parallel(
    rows: Sequence[Row], wanted: Sequence[float], limits: Pair, effort: float
) -> tuple[Pair, bool]:
    """Fingers that all see the same mixture of modes act as one, with the mean of what they want."""
    x, y = max(rows, key=lambda row: max(abs(row[0]), abs(row[1])))
    shares = [(u * x + v * y) / (x * x + y * y) for u, v in rows]
    weight = math.sqrt(sum([share * share for share in shares]))
    together = sum([share * want for share, want in zip(shares, wanted, strict=True)])
    return least_norm((x * weight, y * weight), together / weight, limits, effort)


def shapes_of(rows: Sequence[Row]) -> Shapes2:
    """Two rows, as `solver_pair` takes them."""
    one, other = rows[0], rows[1]
    return one[0], one[1], other[0], other[1]


def _tall_solution(rows: Sequence[Row], wanted: Sequence[float], effort: float) -> Pair | None:
    """More fingers than modes, or effort: orthogonal columns, the larger first; None where one mode says it all."""
    root = math.sqrt(effort)
    first = [row[0] for row in rows] + [root, 0.0]
    second = [row[1] for row in rows] + [0.0, root]
    right = [*wanted, 0.0, 0.0]
    swapped = dot(second, second) > dot(first, first)
    if swapped:
        first, second = second, first
    first_square, second_square = dot(first, first), dot(second, second)
    along = dot(first, second) / first_square
    across = [v - along * u for u, v in zip(first, second, strict=True)]
    across_square = dot(across, across)
    if not across_square > _RANK_NOISE * _RANK_NOISE * second_square:
        return None
    start = dot(first, right) / first_square
    minor = dot(across, [b - start * u for u, b in zip(first, right, strict=True)]) / across_square
    major = dot(first, [b - minor * v for v, b in zip(second, right, strict=True)]) / first_square
    return (minor, major) if swapped else (major, minor)


def _best_on_edge(rows: Sequence[Row], wanted: Sequence[float], edge: float, limit: float, effort: float) -> float:
    """The first mode's best amplitude while the second stands at `edge`."""
    weight = sum([x * x for x, _ in rows]) + effort
    pull = sum([x * (want - y * edge) for (x, y), want in zip(rows, wanted, strict=True)])
    return clamped(pull / weight, limit) if weight > 0.0 else 0.0


def _excess(one: Pair, other: Pair, rows: Sequence[Row], wanted: Sequence[float], effort: float) -> float:
    """Squared error and effort of `one` above that of `other`, without the targets' squares."""
    (x, y), (p, q) = one, other
    excess = effort * ((x - p) * (x + p) + (y - q) * (y + q))
    for (u, v), want in zip(rows, wanted, strict=True):
        excess += (u * (x - p) + v * (y - q)) * (u * (x + p) + v * (y + q) - 2.0 * want)
    return excess
