"""As few knots as the tolerance needs: a polyline through modal amplitudes, refined where a chord would miss them.

Between knots the board interpolates linearly. A chord of span h errs by h^2 W''/8 at most, in the middle of a smooth
piece: so the middle is looked at, and becomes a knot if the chord misses it. A half then errs by a quarter, and is
taken as it is where that is within the tolerance; next to an inflection, or the corner where a mode meets its limit, it
may err by a little more.
Where the target itself has corners (a square grating's edges, a map's pixels) every half is checked in turn, down to
the board's control tick.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from ...values import Knot
from ..phasors import Phasors

Solve = Callable[[int, Knot], Phasors]  # an instant after the first knot, and the knot before it: the amplitudes there

SHORTEST_NS: Final = 500_000  # the board's control tick: a finer polyline is never seen
GRAIN_NS: Final = 4_000  # the wire's unit of time
_Miss = tuple[float, Knot, Knot, Knot]  # by how much a chord misses its middle, in um; left knot, middle, right one


def refine(
    solve: Solve, start: Sequence[Knot], tolerance_um: float, most: int, solves: int, *, smooth: bool
) -> list[Knot]:
    """`start` (two knots or more, in order) and what must lie between, `most` knots in all, and at most so many solves;
    the worst chords first.

    `solve(dt_ns, knot)` gives the amplitudes at an instant, continuing those of the knot to its left. `smooth`
    promises that no span of `start` hides a corner or a whole wave.
    """
    knots = list(start)
    spans = [(knots[i], knots[i + 1]) for i in range(len(knots) - 1)]
    settled_um = 4.0 * tolerance_um if smooth else 0.0
    while spans and len(knots) < most and solves > 0:
        spans = spans[:solves]
        solves -= len(spans)
        misses = [miss for left, right in spans if (miss := _missed(solve, left, right, tolerance_um)) is not None]
        room = most - len(knots)
        if len(misses) > room:
            misses = sorted(misses, key=_severity)[:room]
        spans = []
        for error_um, left, middle, right in misses:
            knots.append(middle)
            if error_um > settled_um:
                spans += ((left, middle), (middle, right))
    if len(knots) > len(start):
        knots.sort()
    return knots


def _missed(solve: Solve, left: Knot, right: Knot, tolerance_um: float) -> _Miss | None:
    left_ns, before_um = left
    right_ns, after_um = right
    span_ns = right_ns - left_ns
    if span_ns < 2 * SHORTEST_NS:
        return None
    half_ns = span_ns // (2 * GRAIN_NS) * GRAIN_NS
    middle_um = solve(left_ns + half_ns, left)
    share = half_ns / span_ns
    error_um = 0.0
    for mode in range(len(before_um)):
        chord_um = before_um[mode] + share * (after_um[mode] - before_um[mode])
        error_um = max(error_um, abs(middle_um[mode] - chord_um))
    return (error_um, left, Knot(left_ns + half_ns, middle_um), right) if error_um > tolerance_um else None


def _severity(miss: _Miss) -> tuple[float, int]:
    error_um, left, _, _ = miss
    return -error_um, left.dt_ns
