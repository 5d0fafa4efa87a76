"""The reach of one finger: the interval of friction that it can feel beside the others with their targets.

A friction is in reach if the solver for friction (`felt`) finds amplitudes with which this finger feels it, within a
just noticeable difference, and every other finger what it asked for, within one, or as well as without this finger.
From bare glass to the most slippery, each of a few frictions is solved for from the solution of the one before; then
both ends of the longest run in reach are bisected. What is felt is judged by more points of the contacts than the
solver's: where large amplitudes cancel, these miss up to a just noticeable difference. A solve may be cut off before
it has converged, because its time is limited: what is said to be in reach is, and a little more may be.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from ...values import FloatArray
from ..friction import FrictionCurve
from ..phasors import Phasors
from ..plate.contact import Shapes
from .felt import MISSED_JND, STAY_FRAC, finger_table, solve_felt
from .felt_descent import COLD, descend

STEPS: Final = 8  # between bare glass and the most slippery
HALVINGS: Final = 4  # of each end: to 0.008
MOST_CALLS: Final = 12  # of the solver for a friction; more find hardly more
COLD_CALLS: Final = COLD
TRIED: Final = STEPS + 1 + 2 * HALVINGS  # frictions
LEAST_CALLS: Final = 2 * (COLD_CALLS + TRIED)
SLACK_JND: Final = 0.02  # by which another finger may miss more than without this one


class _State:
    """Where a search is: amplitudes, and the fingers' weights."""

    def __init__(self, modal_um: Phasors, weights: list[float]) -> None:
        self.modal_um = modal_um
        self.weights = weights

    def copy(self) -> _State:
        return _State(self.modal_um, self.weights.copy())


class Contacts(NamedTuple):
    """The shapes (N, Q, M) at the points of contacts, each a disc with these points (Q, 3)."""

    shapes: Shapes
    disc: FloatArray


class ReachSearch:
    """The other fingers and this one, the last: their contacts, as solved for and as judged, targets of the others, and
    all fingers' gains with speed and priorities."""

    def __init__(
        self,
        contacts: Contacts,
        judged: Contacts,
        curve: FrictionCurve,
        targets_um: list[float],
        limits_um: FloatArray,
        speed_gains: list[float],
        priorities: list[int],
    ) -> None:
        self._contacts: Final = contacts
        self._judged: Final = judged
        self._curve: Final = curve
        self._targets_um: Final = targets_um
        self._limits_um: Final = limits_um
        self._speed_gains: Final = speed_gains
        self._priorities: Final = priorities
        self._allowed_jnd: list[float] = []
        self._calls = 0  # for each friction

    def interval(self, calls: int) -> tuple[float, float] | None:
        """Return the lowest and the highest friction in reach, as a target has it (0 .. 1), by at most so many calls of
        the solver, LEAST_CALLS or more; None where none is."""
        others = len(self._targets_um)
        without_jnd = self._errors_jnd(self._targets_um, self._at_rest(others)) if others > 0 else []
        self._allowed_jnd = [*[max(MISSED_JND, abs(error_jnd) + SLACK_JND) for error_jnd in without_jnd], MISSED_JND]
        self._calls = min((calls - 2 * COLD_CALLS) // TRIED, MOST_CALLS)
        state = self._at_rest(others + 1)
        passed: list[_State] = []
        is_good: list[bool] = []
        for step in range(STEPS + 1):
            is_good.append(self._is_felt(1.0 - step / STEPS, state))
            passed.append(state.copy())
        first, last = _longest_run(is_good)
        return None if first > last else (self._edge(last, 1, passed), self._edge(first, -1, passed))

    def _edge(self, step: int, outwards: int, passed: list[_State]) -> float:
        """Bisect between the last step in reach and the first beyond it."""
        inside = 1.0 - step / STEPS
        if not 0 <= step + outwards <= STEPS:
            return inside
        beyond, state = 1.0 - (step + outwards) / STEPS, passed[step]
        for _ in range(HALVINGS):
            middle, tried = 0.5 * (inside + beyond), state.copy()
            if self._is_felt(middle, tried):
                inside, state = middle, tried
            else:
                beyond = middle
        return inside

    def _is_felt(self, friction_frac: float, state: _State) -> bool:
        """Move the state to where this finger is asked to feel a friction; return whether all feel what they may."""
        own_um = self._curve.amplitude_um(friction_frac) * self._speed_gains[-1]
        for _ in range(self._calls):
            errors_jnd = self._errors_jnd([*self._targets_um, own_um], state)
            if all(abs(errors_jnd[n]) <= self._allowed_jnd[n] for n in range(len(errors_jnd))):
                return True
        return False

    def _at_rest(self, fingers: int) -> _State:
        return _State((0j,) * len(self._limits_um), [0.0] * fingers)

    def _errors_jnd(self, targets_um: list[float], state: _State) -> list[float]:
        """Move the state by one call for the first fingers, which have these targets; return their errors there."""
        count, limits_um, weights = len(targets_um), self._limits_um, state.weights
        (shapes, disc), (judged_shapes, judging) = self._contacts, self._judged
        speed_gains, priorities, fingers = self._speed_gains[:count], self._priorities[:count], len(self._speed_gains)
        shapes = shapes[: count * len(shapes) // fingers]
        state.modal_um, _, _ = solve_felt(
            shapes, disc, self._curve, targets_um, limits_um, state.modal_um, weights, speed_gains, priorities
        )
        table = finger_table(self._curve, targets_um, weights, speed_gains, priorities)
        judged_shapes = judged_shapes[: count * len(judged_shapes) // fingers]
        descend(judged_shapes, judging, table, self._curve.table, limits_um, state.modal_um, 0, STAY_FRAC, math.inf)
        return table[6 * count : 7 * count].tolist()


def _longest_run(is_good: list[bool]) -> tuple[int, int]:
    """Return the first and the last index of the longest run; the last is before the first where there is none."""
    best, start = (0, -1), 0
    for index in range(len(is_good)):
        if not is_good[index]:
            start = index + 1
        elif index - start > best[1] - best[0]:
            best = start, index
    return best
