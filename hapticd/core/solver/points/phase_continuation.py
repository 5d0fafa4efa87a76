"""N slipping fingers on M modes with free phases: a change of sign pattern becomes a turn.

The mathematics of the turn is in `phase`. A turn goes from one real solution to another; while it lasts no finger gets
less than at the worse end.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from operator import mul
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ...phasors import magnitude
from .arithmetic import Phasors, Row, unscaled
from .few_modes import FewModes, Pattern
from .sign_patterns import FloatArray
from .slew_limit import nearer_hand

_REAL_RAD: Final = 1e-6  # fingers this near to one phase, or to the opposite one, vibrate in one real pattern
_NOISE_FLOOR: Final = 1e-9  # of the strongest finger's amplitude: below it a phase is noise
_EQUAL: Final = 1e-9  # of the targets' squares: patterns that serve alike, by least squares' own rounding


class Turn(NamedTuple):
    """Position of the fingers' phasors in a turn: signs at its begin, fingers that change sign by its end, angle."""

    signs: list[float]
    changes: list[bool]
    tau_rad: float


def turn_patterns(problem: FewModes, limits: Row, previous: Phasors, turn_rad: float) -> tuple[Phasors, bool]:
    """One step, of `turn_rad` at most, from the pattern that `previous` has, or is leaving, to the best one."""
    now = _turn_at(problem.shapes, previous)
    best = problem.best(None, now.signs)
    turn = _next_turn(now, problem.shapes, best.modal)
    if turn is None:
        return in_phase(unscaled(problem.reach, best.modal, limits), limits, previous), best.is_limited
    begin, end = problem.with_signs(turn.signs), problem.with_signs(_flipped(turn))
    equal = _EQUAL * sum([target * target for target in problem.targets])
    tau_rad = _stepped(turn.tau_rad, turn_rad, _serves_better(end, begin, equal))
    modal = between(np.array(begin.modal), np.array(end.modal), tau_rad)
    return in_phase((modal * problem.reach).tolist(), limits, previous), begin.is_limited or end.is_limited


def _turn_at(shapes: Sequence[Sequence[float]], previous: Phasors) -> Turn:
    return turn_of([sum(map(mul, row, previous)) for row in shapes])


def _next_turn(turn: Turn, shapes: Sequence[Sequence[float]], best: Sequence[float]) -> Turn | None:
    """The turn that goes on, or else the one to the best pattern, `best` (M,); None where the fingers have that."""
    if turn.tau_rad < _REAL_RAD:
        signs = [math.copysign(1.0, sum(map(mul, row, best))) for row in shapes]
        turn = turn._replace(changes=_changed(turn.signs, signs))
    return turn if any(turn.changes) else None


def _flipped(turn: Turn) -> list[float]:
    """The signs at a turn's end."""
    return [-sign if change else sign for sign, change in zip(turn.signs, turn.changes, strict=True)]


def _stepped(tau_rad: float, turn_rad: float, is_ahead: bool) -> float:
    """A step towards a turn's end, or back."""
    return min(tau_rad + turn_rad, math.pi) if is_ahead else max(tau_rad - turn_rad, 0.0)


def in_phase(modal: Sequence[complex], limits: Row, previous: Phasors | None) -> Phasors:
    """The `nearer_hand` of a solution, in complex numbers; without `previous` it stays as it is, within the limits."""
    near = (0j,) * len(modal) if previous is None else previous
    flat = nearer_hand(_flat(modal), limits, _flat(near))
    return tuple([complex(flat[2 * k], flat[2 * k + 1]) for k in range(len(limits))])


def _flat(phasors: Sequence[complex]) -> Row:
    return tuple([part for w in phasors for part in (w.real, w.imag)])


def between(begin: FloatArray, end: FloatArray, tau_rad: float) -> npt.NDArray[np.complex128]:
    """The turn from one real solution to another, at an angle of 0 to pi; both ends are exact."""
    if tau_rad <= 0.0 or tau_rad >= math.pi:
        return np.asarray(end if tau_rad > 0.0 else begin, np.complex128)
    return (begin + end) / 2 + cmath.exp(1j * tau_rad) * ((begin - end) / 2)


def turn_of(phasors: Sequence[complex]) -> Turn:
    """The turn in which fingers with these phasors are; phases are relative to the strongest one's."""
    sizes = [magnitude(w.real, w.imag) for w in phasors]
    size = max(sizes)
    towards = phasors[sizes.index(size)].conjugate() / size if size > 0.0 else 0j
    relative = [w * towards if own > _NOISE_FLOOR * size else 0j for w, own in zip(phasors, sizes, strict=True)]
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
    """Fingers that differ between two patterns, each known up to a common sign: the fewer."""
    differ = [sign != other for sign, other in zip(signs, others, strict=True)]
    return differ if 2 * sum(differ) <= len(differ) else [not one for one in differ]


def _serves_better(one: Pattern, other: Pattern, equal: float) -> bool:
    """Rules (3) and (4) of the solver between two patterns."""
    excess = one.error - other.error
    if abs(excess) > equal:
        return excess < 0.0
    return one.square < other.square
