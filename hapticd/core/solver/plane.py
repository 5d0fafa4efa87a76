"""The solver's closed forms for one and two modes, in plain floats: what runs at every knot of every frame.

With a still finger the modes left to choose from lie on a line, direction (phi_Y, -phi_X) of that finger (the paper's
rule, section IV.B: what is limited is scaled along it). Without one they fill the box |W_k| <= limit_k: see
`core.solver.box`. All tests of "zero" are relative to the terms that cancelled, so the scale of phi never matters.
One mode is the plane with a second mode that moves no finger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from .arithmetic import NOISE, Pair, Row, cross_terms, within
from .box import fill_box


def solve_plane(
    still: Sequence[Row],
    slipping: Sequence[Row],
    targets: Sequence[float],
    limits: Pair,
    previous: Row | None,
    effort: float = 0.0,
    hysteresis: float = 0.0,
) -> tuple[Row, bool]:
    """The rows of the still and of the slipping fingers, and the latter's targets: modal amplitudes, and whether a
    limit keeps some finger from its target."""
    bound = [row for row in still if row[0] != 0.0 or row[1] != 0.0]  # a node of both modes is still anyway
    if not bound:
        return fill_box(slipping, targets, limits, previous, effort, hysteresis)
    direction = common_direction(bound)
    if direction is None:
        return (0.0, 0.0), False
    return slide_on_line(direction, slipping, targets, limits, previous, effort)


def common_direction(still: Sequence[Row]) -> Pair | None:
    """The (W_X, W_Y), largest entry 1, that moves none of these fingers; None where only silence does."""
    x, y = still[0]
    for other_x, other_y in still[1:]:
        forward, backward = cross_terms((x, y), (other_x, other_y))
        if abs(forward - backward) > NOISE * (abs(forward) + abs(backward)):
            return None
    if abs(y) >= abs(x):
        return 1.0, -x / y
    return -y / x, 1.0


def slide_on_line(
    direction: Pair,
    slipping: Sequence[Row],
    targets: Sequence[float],
    limits: Pair,
    previous: Row | None,
    effort: float,
) -> tuple[Row, bool]:
    """The W = t * direction within the limits that serves the slipping fingers best; t's sign follows `previous`."""
    ux, uy = direction
    gains = [gain_along(row, direction) for row in slipping]
    largest = max([abs(gain) for gain in gains])
    if not 0.0 < largest < math.inf:
        return (0.0, 0.0), False
    pull = sum([abs(gain) / largest * target for gain, target in zip(gains, targets, strict=True)])
    grip = sum([(gain / largest) * (gain / largest) for gain in gains])
    wanted = pull / (largest * grip + effort * (ux * ux + uy * uy) / largest)
    top = farthest(direction, limits)
    limited = not wanted <= top
    t = min(wanted, top) if wanted == wanted else 0.0
    leading = next(gain for gain in gains if gain != 0.0)
    if faces_away(direction, leading, previous):
        t = -t
    return within((t * ux, t * uy), limits), limited


def gain_along(row: Row, direction: Pair) -> float:
    """What a finger gets of the line's direction, um per um; exactly 0 where the rounding of phi hides it."""
    first, second = row[0] * direction[0], row[1] * direction[1]
    gain = first + second
    return gain if abs(gain) > NOISE * (abs(first) + abs(second)) else 0.0


def farthest(direction: Pair, limits: Pair) -> float:
    """How far along `direction`, whose larger entry is +-1, the box reaches."""
    (ux, uy), (limit_x, limit_y) = direction, limits
    major, minor, slope = (limit_x, limit_y, abs(uy)) if abs(ux) == 1.0 else (limit_y, limit_x, abs(ux))
    return minor / slope if slope * major > minor else major


def faces_away(direction: Pair, gain: float, previous: Row | None) -> bool:
    """Whether t must be negative to lie nearest `previous`; without one the finger's amplitude is positive."""
    if previous is not None:
        lean = previous[0] * direction[0] + previous[1] * direction[1]
        if lean != 0.0:
            return lean < 0.0
    return gain < 0.0
