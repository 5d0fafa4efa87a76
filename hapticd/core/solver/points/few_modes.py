"""A few slipping fingers on two or three modes, on plain floats: each sign pattern is a small least-squares problem.

Rules (3) and (4) of the solver are one sum here: error + DAMPING^2 |W|^2 is least, in units of the largest limit and
the largest gain. So no rank has to be judged, and of two patterns that serve alike the smaller wins.

Where the minimum without limits violates some, the minimum within them lies on one of those: else a step towards the
former would improve it. So each violated limit in turn is met, which leaves the same problem with one direction less
(`faces`). A pattern whose bound has lost is left; the one that the fingers have is tried first, being best as a rule.
"""

from __future__ import annotations

import math
from typing import Final

from ...small_matrices import Vector, complement_of_any, dot
from .arithmetic import EQUAL_ERROR, EQUAL_NORM, MISSED, SAFE, Row, Rows, clamped
from .faces import DAMPING, Face

MOST_SLIPPING: Final = 5  # 16 patterns; above it, a descent takes less time
MOST_MODES: Final = 3  # plates of more serve contacts
_LEAST_GAIN: Final = 1e-6  # of a row: below it the slipping fingers are all but still
_MOST_REACH: Final = 1e3  # of a target, times what the limits can give
_LEAST_LIMIT: Final = 1e-3  # of the largest


class Pattern:
    """The best amplitudes of one sign pattern, `modal` (M,) in units of the problem's reach. `is_limited`: a limit bent
    them, and some finger misses its target by more than rounding."""

    __slots__ = ("error", "is_limited", "modal", "square")

    def __init__(self, modal: Vector, error: float, is_limited: bool) -> None:
        self.modal: Final = modal
        self.error: Final = error
        self.square: Final = dot(modal, modal)
        self.is_limited: Final = is_limited


class FewModes:
    """A problem: `rows` (n, M) and `targets` (n,) of the slipping fingers, `box` (M,), and the `directions` (r, M) that
    the still fingers leave; `shapes` are the rows as they were given, before scaling."""

    def __init__(
        self,
        shapes: list[Vector],
        directions: list[Vector],
        rows: list[Vector],
        targets: Vector,
        box: Vector,
        reach: float,
    ) -> None:
        self.shapes: Final = shapes
        self.targets: Final = targets
        self.reach: Final = reach
        self._rows: Final = rows
        self._box: Final = box
        self._face: Final = Face(rows, box, directions, [])

    def best(self, previous: Row | None, first: Vector | None = None) -> Pattern:
        """The best of all patterns; of equals, the one nearest `previous` (M,), in um, and on its side. The signs
        `first` (n,), without them those that `previous` gives, are tried first."""
        near = [0.0] * len(self._box)
        if previous is not None:
            near = [clamped(w_um / self.reach, SAFE) for w_um in previous]
        if first is None:
            first = [1.0 if dot(row, near) >= 0.0 else -1.0 for row in self._rows]
        found: list[Pattern] = []
        best, ceiling = self.with_signs(first), math.inf
        for code in range(1 << (len(first) - 1)):
            signs = list(first)
            for index in range(len(first) - 1):
                if (code >> index) & 1:
                    signs[index + 1] = -signs[index + 1]
            one = best if code == 0 else self._solved(signs, ceiling)
            if one is not None:
                found.append(one)
                if _cost(one) <= _cost(best):
                    best = one
                    ceiling = _cost(best) + EQUAL_ERROR * best.error + EQUAL_NORM * DAMPING * DAMPING * best.square
        nearest = math.inf
        for one in found:
            if _cost(one) <= ceiling:
                distance = one.square - 2.0 * abs(dot(one.modal, near))
                if distance < nearest:
                    best, nearest = one, distance
        return best if dot(best.modal, near) >= 0.0 else _mirrored(best)

    def with_signs(self, signs: Vector) -> Pattern:
        """The pattern of given signs of the slipping fingers."""
        found = self._solved(signs, math.inf)
        return self._pattern([0.0] * len(self._box), True) if found is None else found

    def _solved(self, signs: Vector, ceiling: float) -> Pattern | None:
        """None where the cost is above the ceiling."""
        wanted = [0.0] * len(signs)
        for finger in range(len(signs)):
            wanted[finger] = signs[finger] * self.targets[finger]
        found = self._face.least(wanted, [0.0] * len(self._box), ceiling)
        return None if found is None else self._pattern(found[0], found[2])

    def _pattern(self, modal: Vector, is_bent: bool) -> Pattern:
        beyond = 1.0  # by rounding: all modes are scaled together, so the still fingers stay still
        for mode in range(len(modal)):
            beyond = max(beyond, abs(modal[mode]) / self._box[mode])
        if beyond > 1.0:
            modal = [w / beyond for w in modal]
        error, is_missed = 0.0, False
        for finger in range(len(self._rows)):
            missed = abs(dot(self._rows[finger], modal)) - self.targets[finger]
            error += missed * missed
            is_missed = is_missed or not abs(missed) <= MISSED * self.targets[finger]
        return Pattern(modal, error, is_bent and is_missed)


def _cost(one: Pattern) -> float:
    return one.error + DAMPING * DAMPING * one.square


def _mirrored(one: Pattern) -> Pattern:
    return Pattern([-w for w in one.modal], one.error, one.is_limited)


# --- the problem ----------------------------------------------------------------------------------------------------


def pose_few(rows: Rows, targets: Row, limits: Row) -> FewModes | None:
    """The problem; None where it is not one of few modes, few fingers and ordinary numbers, or nothing can be moved."""
    modes = len(limits)
    still: list[Vector] = []
    slipping: list[Vector] = []
    wanted: Vector = []
    for finger in range(len(rows)):
        row, target, size = rows[finger], targets[finger], 0.0
        for shape in row:
            if not abs(shape) < SAFE:
                return None
            size = max(size, abs(shape))
        if target > 0.0:
            slipping.append(list(row))
            wanted.append(target)
        elif size > 0.0:
            still.append([shape / size for shape in row])
    if modes > MOST_MODES or not 0 < len(slipping) <= MOST_SLIPPING:
        return None
    directions = complement_of_any(still, modes)
    return None if not directions else _scaled(directions, slipping, wanted, limits)


def _scaled(directions: list[Vector], slipping: list[Vector], wanted: Vector, limits: Row) -> FewModes | None:
    largest = size = 0.0
    for row in slipping:
        for direction in directions:
            largest = max(largest, abs(dot(row, direction)))
        for shape in row:
            size = max(size, abs(shape))
    reach = max(limits)
    if not (size > 1.0 / SAFE and largest > _LEAST_GAIN * size):
        return None
    if not (1.0 / SAFE < reach < SAFE and min(limits) > _LEAST_LIMIT * reach):
        return None
    scale = reach * largest
    if not max(wanted) < _MOST_REACH * scale:
        return None
    targets, box = [target / scale for target in wanted], [limit / reach for limit in limits]
    return FewModes(slipping, directions, [[shape / largest for shape in row] for row in slipping], targets, box, reach)
