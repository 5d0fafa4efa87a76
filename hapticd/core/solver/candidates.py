"""Which of several modal solutions to take: rules (3), (4) and (5) of the lexicographic order in `core.solver`.

Every sign pattern of the slipping fingers' amplitudes gives one candidate; the best by squared error wins, of equals
the least in |W|^2, of those the one nearest to what the plate does now. "Equal" means within rounding; `hysteresis`
widens it, so that a plate near a tie does not change its pattern with every report: a change of pattern carries some
finger through zero, and the finger feels it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from .arithmetic import Row

EQUAL_ERROR: Final = 1e-13  # of the targets' scale, squared: candidates that differ by rounding alone
EQUAL_NORM: Final = 1e-9  # least norms of exact solutions carry the conditioning of phi


class Candidate(NamedTuple):
    """Modal amplitudes, the amplitude that they give each finger, and whether a limit bent them."""

    modal: Row
    amplitudes: Row
    clamped: bool


def candidate(modal: Row, rows: Sequence[Row], clamped: bool) -> Candidate:
    """A candidate with its amplitudes |row . modal|."""
    amplitudes = tuple([abs(sum([phi * w for phi, w in zip(row, modal, strict=True)])) for row in rows])
    return Candidate(modal, amplitudes, clamped)


def choose(
    candidates: Sequence[Candidate],
    targets: Sequence[float],
    previous: Row | None,
    effort: float = 0.0,
    hysteresis: float = 0.0,
) -> Candidate:
    """The candidate that rules (3), (4), (5) prefer, turned (W or -W: the fingers cannot tell) towards `previous`."""
    if len(candidates) == 1:
        return _turned(candidates[0], previous)
    width = hysteresis if previous is not None else 0.0
    best = candidates[0]
    for other in candidates[1:]:
        if excess_error(other, best, targets, effort) < 0.0:
            best = other
    scale = sum([a * v for a, v in zip(targets, best.amplitudes, strict=True)])
    allowed = max(EQUAL_ERROR, width) * scale
    equal = [one for one in candidates if not excess_error(one, best, targets, effort) > allowed]
    least = min([square(one.modal) for one in equal])
    allowed = least * (1.0 + max(EQUAL_NORM, width))
    equal = [_turned(one, previous) for one in equal if not square(one.modal) > allowed]
    if previous is None or len(equal) == 1:
        return equal[0]
    return min(equal, key=lambda one: _distance(one.modal, previous))


def excess_error(one: Candidate, other: Candidate, targets: Sequence[float], effort: float) -> float:
    """Squared error (and effort) of `one` above that of `other`.

    As a sum of (v - u)(v + u - 2a): the targets' squares, which may dwarf the difference, never enter.
    """
    excess = effort * (square(one.modal) - square(other.modal)) if effort > 0.0 else 0.0
    for v, u, a in zip(one.amplitudes, other.amplitudes, targets, strict=True):
        excess += (v - u) * (v + u - 2.0 * a)
    return excess


def square(modal: Row) -> float:
    """|W|^2."""
    return sum([w * w for w in modal])


def misses(amplitudes: Sequence[float], targets: Sequence[float]) -> bool:
    """Some finger does not get its target, by more than rounding."""
    return any(not abs(v - a) <= 1e-9 * a for v, a in zip(amplitudes, targets, strict=True))


def leans_away(modal: Row, previous: Row) -> bool:
    """-W lies nearer `previous` than W does."""
    return sum([w * p for w, p in zip(modal, previous, strict=True)]) < 0.0


def _turned(one: Candidate, previous: Row | None) -> Candidate:
    if previous is None or not leans_away(one.modal, previous):
        return one
    return one._replace(modal=tuple([-w for w in one.modal]))


def _distance(modal: Row, previous: Row) -> float:
    return sum([(w - p) * (w - p) for w, p in zip(modal, previous, strict=True)])
