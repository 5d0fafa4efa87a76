"""Phasors that follow what the plate does: a common phase, and the turn from one sign pattern to another.

A phase common to all fingers, and whether the turn between them is left- or right-handed, no finger can tell: of
these the one nearest to the present phasors is taken. The turn's mathematics is told in `core.solver.phase`.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

from .arithmetic import LAST_BIT, Row, length
from .candidates import misses, square
from .general import solve_pattern
from .policies import Rows, solve_fast

Phasors = tuple[complex, ...]

_REAL_RAD = 1e-6  # fingers this near to one phase, or opposite, vibrate in one real pattern
_HEARD = 1e-9  # of the strongest finger's amplitude: below, a phase is noise
_EQUAL = 1e-9  # of the targets' squares: patterns that serve alike, by least squares' own rounding


class Turn(NamedTuple):
    """Where the phasors of fingers stand in a turn: signs at its begin, who changes sign by its end, the angle."""

    signs: list[float]
    changes: list[bool]
    tau_rad: float


def turn_patterns(rows: Rows, targets: Row, limits: Row, previous: Phasors, turn_rad: float) -> tuple[Phasors, bool]:
    """One step, of `turn_rad` at most, from the pattern that `previous` has, or is leaving, to the best one."""
    best, limited = solve_fast(rows, targets, limits)
    still = [row for row, target in zip(rows, targets, strict=True) if target == 0.0]
    slipping = [row for row, target in zip(rows, targets, strict=True) if target > 0.0]
    wanted = [target for target in targets if target > 0.0]
    turn = turn_of(given(_at_one_scale(slipping), previous))
    if turn.tau_rad < _REAL_RAD:
        signs = [math.copysign(1.0, w.real) for w in given(slipping, best)]
        turn = turn._replace(changes=_changed(turn.signs, signs))
        if not any(turn.changes):
            return in_phase(best, limits, previous), limited
    begin = solve_pattern(still, slipping, wanted, turn.signs, limits)
    flipped = [-sign if change else sign for sign, change in zip(turn.signs, turn.changes, strict=True)]
    end = solve_pattern(still, slipping, wanted, flipped, limits)
    if _serves_better(end, begin, slipping, wanted):
        tau_rad = min(turn.tau_rad + turn_rad, math.pi)
    else:
        tau_rad = max(turn.tau_rad - turn_rad, 0.0)
    modal = between(begin, end, tau_rad)
    missed = misses([magnitude(w) for w in given(slipping, modal)], wanted)
    return nearer_hand(modal, limits, previous), missed


def between(begin: Row, end: Row, tau_rad: float) -> Phasors:
    """The turn from one real solution to another, at an angle of 0 to pi; both ends are exact."""
    if tau_rad <= 0.0 or tau_rad >= math.pi:
        return tuple(map(complex, end if tau_rad > 0.0 else begin))
    factor = cmath.exp(1j * tau_rad)
    return tuple([(p + q) / 2 + factor * ((p - q) / 2) for p, q in zip(begin, end, strict=True)])


def _at_one_scale(rows: Sequence[Row]) -> list[Row]:
    """Rows at a largest entry of 1: phases are the same, and what they are told from is within the floats' range."""
    size = max([max(map(abs, row)) for row in rows])
    return [tuple([value / size for value in row]) for row in rows] if size > 0.0 else list(rows)


def turn_of(phasors: Sequence[complex]) -> Turn:
    """The turn in which fingers with these phasors stand; phases are told from the strongest one's."""
    strongest = max(phasors, key=magnitude)
    size = magnitude(strongest)
    towards = strongest.conjugate() / size if size > 0.0 else 0j
    relative = [w * towards if magnitude(w) > _HEARD * size else 0j for w in phasors]
    # Not cmath.phase: it raises where an angle is below the range of floats.
    folded = [math.atan2(w.imag, w.real) % math.pi for w in relative]
    leader = max(folded, key=lambda angle: _apart(angle, 0.0))
    signs = [math.copysign(1.0, w.real) for w in relative]
    changes = [False] * len(signs)
    if _apart(leader, 0.0) < _REAL_RAD:
        return Turn(signs, changes, 0.0)
    turned = 0j
    for index, (w, angle) in enumerate(zip(relative, folded, strict=True)):
        if w != 0j and _apart(angle, leader) < _apart(angle, 0.0):
            changes[index] = True
            signs[index] = math.copysign(1.0, w.imag)
            turned += w * signs[index]
    return Turn(signs, changes, min(max(math.atan2(turned.imag, turned.real), 0.0), math.pi))


def _apart(one_rad: float, other_rad: float) -> float:
    """The angle between two lines."""
    apart = abs(one_rad - other_rad) % math.pi
    return min(apart, math.pi - apart)


def _changed(signs: Sequence[float], others: Sequence[float]) -> list[bool]:
    """Which of the fingers differ between two patterns, each told up to a common sign: the fewer."""
    differ = [sign != other for sign, other in zip(signs, others, strict=True)]
    return differ if 2 * sum(differ) <= len(differ) else [not one for one in differ]


def _serves_better(one: Row, other: Row, slipping: Sequence[Row], targets: Sequence[float]) -> bool:
    """Rules (3) and (4) of `core.solver` between two patterns."""
    excess, scale = 0.0, 0.0
    for w, v, target in zip(given(slipping, one), given(slipping, other), targets, strict=True):
        excess += (magnitude(w) - magnitude(v)) * (magnitude(w) + magnitude(v) - 2.0 * target)
        scale += target * target
    if abs(excess) > _EQUAL * scale:
        return excess < 0.0
    return square(one) < square(other)


def magnitude(w: complex) -> float:
    """|w|, inf where it is beyond the range of floats: `abs` would raise."""
    return length(w.real, w.imag)


# --- what no finger can tell ----------------------------------------------------------------------------------------


def given(rows: Sequence[Row], modal: Sequence[complex]) -> list[complex]:
    """The phasors that modal phasors give the fingers."""
    return [sum([shape * w for shape, w in zip(row, modal, strict=True)], 0j) for row in rows]


def nearer_hand(modal: Phasors, limits: Row, previous: Phasors | None) -> Phasors:
    """A solution or its mirror image, left- or right-handed, whichever comes nearer to the present phasors."""
    if previous is not None:
        mirrored = tuple([w.conjugate() for w in modal])
        if magnitude(_lean(mirrored, previous)) > magnitude(_lean(modal, previous)):
            return in_phase(mirrored, limits, previous)
    return in_phase(modal, limits, previous)


def in_phase(modal: Sequence[complex], limits: Row, previous: Phasors | None) -> Phasors:
    """A solution at the common phase that is nearest to the present phasors, within the limits to the last bit."""
    lean = 0j if previous is None else _lean(modal, previous)
    size = magnitude(lean)
    factor = lean / size if 0.0 < size < math.inf else 1 + 0j
    fits = all(w.imag == 0.0 and abs(w.real) <= limit for w, limit in zip(modal, limits, strict=True))
    if fits and factor.imag == 0.0:
        return tuple([complex(w.real * factor.real) for w in modal])
    return _within(tuple([w * factor for w in modal]), limits)


def _lean(modal: Sequence[complex], previous: Phasors) -> complex:
    """The inner product: its phase is how far `previous` is ahead."""
    return sum([w.conjugate() * p for w, p in zip(modal, previous, strict=True)], 0j)


def _within(modal: Phasors, limits: Row) -> Phasors:
    """All modes scaled by what rounding left beyond a limit: a still finger stays still."""
    shave = 2.0**-53
    while any(magnitude(w) > limit * LAST_BIT for w, limit in zip(modal, limits, strict=True)):
        modal = tuple([w * (1.0 - shave) for w in modal])
        shave *= 2.0
    return modal
