"""Many fingers: their phases by descent, at a cost that grows with the number of fingers alone.

The best signs of n fingers are one of 2^(n-1) patterns, and their best phases no convex problem either. Instead each
finger's phase is held at what it is. With u_i of size 1 in that phase, |w_i| a_i >= Re(u_i* w_i) a_i, so

    sum_i |w_i - u_i a_i|^2 >= sum_i (|w_i| - a_i)^2,   equal at the present W:

the W that is best for these phases is better for the fingers too, and its phases are the next ones (majorization; the
method of R. W. Gerchberg and W. O. Saxton, Optik 35, 1972). That W is linear in u_i a_i, the same matrix for all steps
of a call. The still fingers' amplitudes are 0 in it because it leads into what they do not see.

Limits are discs |W_k| <= L_k. W is drawn towards V, its projection into them, by HOLD_FRAC of the fingers' own pull,
and what V has cut off so far is added to the next (alternating direction method of multipliers: D. Gabay and B.
Mercier, Computers & Mathematics with Applications 2, 1976). What is left beyond a limit at the end scales all modes
together, so still fingers stay still.

Each step is a continuous function of the fingers and of the W before, and a call makes few: W follows the fingers, and
never flips. From real W they stay real: signs. With free phases the descent ends nearer to the targets than the best
signs do (six to ten fingers miss 0.87 instead of 0.98 um). A step costs O(n M), a call O(N M^2 + M^3) besides.
"""

from __future__ import annotations

import math
from typing import Final

from ...phasors import NOISE, ModeRow, ModeRows, magnitude
from ...small_matrices import Vector, complement_of_any, dot, dot_of_two, inverse

STEPS: Final = 6  # of a call; 10 take 1 % off the error and turn modes faster
COLD_STEPS: Final = 40  # from rest
TRIED_STEPS: Final = 12  # tell which of several starts is best
HOLD_FRAC: Final = 0.3  # of the mean curvature; 0.1 turns modes by half as much again a call, 1 follows more slowly
FADE_FRAC: Final = 3e-4  # the same: what no finger feels fades in some 100 calls, and targets are missed by as much
LEAST_SHARE: Final = 0.05  # of a target: what gets less turns to where it would begin
COLD_TURN_RAD: Final = 2.4  # from finger to finger where they begin: no pattern of signs is preferred
SHORT_FRAC: Final = 0.01  # of a target or a limit: a finger that lacks more is limited by a mode so near its limit
_MOST_REACH: Final = 1e3  # a target so many times out of reach acts like any farther one
_ROUNDING: Final = 1.0 - 2.0**-50  # of a limit


class Descent:
    """A problem in units of the largest limit and the largest gain: `rows` (n, M) and `targets` (n,) of the slipping
    fingers, `box` (M,). `leading` (M, M) takes a pull to the best W that the still fingers do not feel; `begin_d` and
    `begin_q` (n,) are the targets in the phases of fingers that have none of their own yet."""

    __slots__ = ("_begin_d", "_begin_q", "_box", "_columns", "_hold", "_leading", "_rows", "_targets")

    def __init__(
        self, rows: list[Vector], targets: Vector, box: Vector, directions: list[Vector], *, is_real: bool
    ) -> None:
        self._rows: Final = rows
        self._targets: Final = targets
        self._box: Final = box
        self._columns: Final = [[row[mode] for row in rows] for mode in range(len(box))]
        is_whole = len(directions) == len(box)
        curvature = _squares(self._columns)
        if not is_whole:
            curvature = _between(directions, curvature)
        mean = 0.0
        for index in range(len(curvature)):
            mean += curvature[index][index] / len(curvature)
        self._hold: Final = HOLD_FRAC * mean
        for index in range(len(curvature)):
            own = curvature[index]
            own[index] = own[index] + self._hold + FADE_FRAC * mean
        leading = inverse(curvature)
        if not is_whole:
            leading = _between([[direction[mode] for direction in directions] for mode in range(len(box))], leading)
        self._leading: Final = leading
        self._begin_d: Final[Vector] = []
        self._begin_q: Final[Vector] = []
        for finger in range(len(targets)):
            turn_rad = COLD_TURN_RAD * finger
            self._begin_d.append(targets[finger] * math.cos(turn_rad))
            self._begin_q.append(0.0 if is_real else targets[finger] * math.sin(turn_rad))

    def begin(self, d: Vector, q: Vector, *, is_real: bool) -> None:
        """Set W to the sum of what would serve each finger alone. Signs of several fingers end farther from the best
        than phases do, so that and each mode alone are tried."""
        for mode in range(len(d)):
            w_d, w_q = dot_of_two(self._columns[mode], self._begin_d, self._begin_q)
            d[mode], q[mode] = w_d, w_q
        if not is_real or len(self._targets) == 1:
            return
        self.descend(d, q, TRIED_STEPS)
        least, best = self._error(d), d.copy()
        for mode in range(len(d)):
            for other in range(len(d)):
                d[other] = self._box[mode] if other == mode else 0.0
            self.descend(d, q, TRIED_STEPS)
            error = self._error(d)
            if error < least:
                least, best = error, d.copy()
        for mode in range(len(d)):
            d[mode] = best[mode]

    def _error(self, d: Vector) -> float:
        """What the fingers miss of their targets, with real amplitudes within the limits."""
        share = 1.0 / max(self.beyond(d, [0.0] * len(d)), 1.0)
        error = 0.0
        for finger in range(len(self._rows)):
            missed = share * abs(dot(self._rows[finger], d)) - self._targets[finger]
            error += missed * missed
        return error

    def descend(self, d: Vector, q: Vector, steps: int) -> None:
        """Move W, given in its parts, towards the best."""
        count = len(d)
        zeros = [0.0] * count
        cut_d, cut_q, pull_d, pull_q = zeros.copy(), zeros.copy(), zeros.copy(), zeros.copy()
        held_d, held_q = d.copy(), q.copy()  # V less what is cut off
        for _ in range(steps):
            asked_d, asked_q = self._asked(d, q)
            for mode in range(count):
                w_d, w_q = dot_of_two(self._columns[mode], asked_d, asked_q)
                pull_d[mode], pull_q[mode] = w_d + self._hold * held_d[mode], w_q + self._hold * held_q[mode]
            for mode in range(count):
                limit = self._box[mode]
                w_d, w_q = dot_of_two(self._leading[mode], pull_d, pull_q)
                d[mode], q[mode] = w_d, w_q
                w_d, w_q = w_d + cut_d[mode], w_q + cut_q[mode]
                size = magnitude(w_d, w_q)
                share = limit / size if size > limit else 1.0
                cut_d[mode], cut_q[mode] = w_d * (1.0 - share), w_q * (1.0 - share)
                held_d[mode], held_q[mode] = w_d * (2.0 * share - 1.0), w_q * (2.0 * share - 1.0)

    def _asked(self, d: Vector, q: Vector) -> tuple[Vector, Vector]:
        """Each finger's target in its present phase."""
        asked_d, asked_q = [0.0] * len(self._rows), [0.0] * len(self._rows)
        for finger in range(len(self._rows)):
            target = self._targets[finger]
            least = LEAST_SHARE * target
            w_d, w_q = dot_of_two(self._rows[finger], d, q)
            size = magnitude(w_d, w_q)
            if size > least:
                share = target / size
                asked_d[finger], asked_q[finger] = w_d * share, w_q * share
            elif least > 0.0:
                share = 1.0 - size / least
                asked_d[finger] = w_d / LEAST_SHARE + share * self._begin_d[finger]
                asked_q[finger] = w_q / LEAST_SHARE + share * self._begin_q[finger]
        return asked_d, asked_q

    def beyond(self, d: Vector, q: Vector) -> float:
        """The largest |W_k| in units of its limit."""
        largest = 0.0
        for mode in range(len(d)):
            size = magnitude(d[mode], q[mode])
            if size > largest * self._box[mode]:
                largest = size / self._box[mode] if self._box[mode] > 0.0 else math.inf
        return largest

    def is_short(self, d: Vector, q: Vector) -> bool:
        """Some finger gets less than its target."""
        for finger in range(len(self._rows)):
            w_d, w_q = dot_of_two(self._rows[finger], d, q)
            if magnitude(w_d, w_q) < (1.0 - SHORT_FRAC) * self._targets[finger]:
                return True
        return False


def serve_many(rows: ModeRows, targets: ModeRow, limits: ModeRow, d_um: Vector, q_um: Vector, *, is_real: bool) -> bool:
    """Move W (M,), given in its parts, to where the fingers' errors are less; return `limited`.

    Without a slipping finger, and where as many fingers are still as there are modes, W becomes 0. If W is 0, or no
    number, the search starts from the targets.
    """
    reach = max(limits)
    problem = _posed(rows, targets, limits, is_real)
    if problem is None:
        for mode in range(len(limits)):
            d_um[mode] = q_um[mode] = 0.0
        return False
    is_cold = True
    for mode in range(len(limits)):
        size_um = magnitude(d_um[mode], q_um[mode])
        share = min(limits[mode] / size_um, 1.0) if 0.0 < size_um < math.inf else 0.0
        if share > 0.0:
            d_um[mode], q_um[mode] = d_um[mode] * share / reach, q_um[mode] * share / reach
            is_cold = False
        else:
            d_um[mode] = q_um[mode] = 0.0
    if is_cold:
        problem.begin(d_um, q_um, is_real=is_real)
    problem.descend(d_um, q_um, COLD_STEPS if is_cold else STEPS)
    beyond = problem.beyond(d_um, q_um)
    is_limited = beyond > 1.0 - SHORT_FRAC and problem.is_short(d_um, q_um)
    share = _ROUNDING / beyond if beyond > _ROUNDING else 1.0
    _scale_within(d_um, q_um, share * reach, limits)
    return is_limited


def _scale_within(d: Vector, q: Vector, share: float, limits: ModeRow) -> None:
    """Scale all modes together, by less where rounding leaves some beyond its limit."""
    for mode in range(len(d)):
        w_d, w_q, shave = d[mode] * share, q[mode] * share, 2.0**-52
        while magnitude(w_d, w_q) > limits[mode]:  # only where limits are below the normal range of floats
            w_d, w_q, shave = w_d * (1.0 - shave), w_q * (1.0 - shave), 2.0 * shave
        d[mode], q[mode] = w_d, w_q


def _posed(rows: ModeRows, targets: ModeRow, limits: ModeRow, is_real: bool) -> Descent | None:
    """The problem; None where only silence serves: no finger slips or can be moved, or phi is not finite."""
    still: list[Vector] = []
    slipping: list[ModeRow] = []
    wanted: Vector = []
    largest = 0.0
    for finger in range(len(rows)):
        row, size = rows[finger], 0.0
        for shape in row:
            if not abs(shape) < math.inf:
                return None
            size = max(size, abs(shape))
        if targets[finger] > 0.0:
            slipping.append(row)
            wanted.append(targets[finger])
            largest = max(largest, size)
        elif size > 0.0:
            still.append([shape / size for shape in row])
    if largest == 0.0:
        return None
    directions = complement_of_any(still, len(limits))
    return None if not directions else _scaled(slipping, wanted, limits, directions, largest, is_real)


def _scaled(
    slipping: list[ModeRow], wanted: Vector, limits: ModeRow, directions: list[Vector], largest: float, is_real: bool
) -> Descent | None:
    scaled = [[shape / largest for shape in row] for row in slipping]
    gain = 0.0
    for row in scaled:
        for direction in directions:
            gain = max(gain, abs(dot(row, direction)))
    if not gain > NOISE:
        return None
    reach = max(limits)
    targets = [min(target / largest / gain / reach, _MOST_REACH) for target in wanted]
    for row in scaled:
        for mode in range(len(row)):
            row[mode] = row[mode] / gain
    return Descent(scaled, targets, [limit / reach for limit in limits], directions, is_real=is_real)


def _squares(columns: list[Vector]) -> list[Vector]:
    """Inner products of all columns."""
    squares = [[0.0] * len(columns) for _ in columns]
    for index in range(len(columns)):
        for other in range(index + 1):
            squares[index][other] = squares[other][index] = dot(columns[index], columns[other])
    return squares


def _between(rows: list[Vector], matrix: list[Vector]) -> list[Vector]:
    """R A R', symmetric as A is."""
    turned = [[dot(line, row) for line in matrix] for row in rows]
    product = [[0.0] * len(rows) for _ in rows]
    for index in range(len(rows)):
        for other in range(index + 1):
            product[index][other] = product[other][index] = dot(turned[index], rows[other])
    return product
