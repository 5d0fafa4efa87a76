"""The reach of one finger: the interval of friction that it can feel beside the others with their targets.

A friction is in reach if the solver for friction (`instant`) finds amplitudes with which this finger feels it, within a
just noticeable difference, and every other finger what it asked for, within one, or as well as without this finger.
From bare glass to the most slippery, each of a few frictions is solved for from the solution of the one before; then
both ends of the longest run in reach are bisected. What is felt is judged by more points of the contacts than the
solver's: where large amplitudes cancel, these miss up to a just noticeable difference. A solve may be cut off before
it has converged, because its time is limited: what is said to be in reach is, and a little more may be.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..phasors import Phasors
from ..plate.contact import JUDGED_DISC, SOLVED_DISC, Ellipses
from .felt_descent import COLD, descend
from .instant import ITERATIONS, AskedPlace, InstantSolver, finger_table

MISSED_JND: Final = 1.0
STEPS: Final = 8  # between bare glass and the most slippery
HALVINGS: Final = 4  # of each end: to 0.008
MOST_CALLS: Final = 12  # of the solver for a friction; more find hardly more
TRIED: Final = STEPS + 1 + 2 * HALVINGS  # frictions
LEAST_CALLS: Final = 2 * (COLD + TRIED)
SLACK_JND: Final = 0.02  # by which another finger may miss more than without this one

_State = tuple[Phasors, list[float]]  # where a search is: amplitudes, and the fingers' weights


class ReachSearch:
    """The fingers with their targets, of which the last is this one: their places, gains with speed, priorities and
    ellipses, as `InstantSolver.solve` takes them."""

    def __init__(
        self,
        solver: InstantSolver,
        places: list[AskedPlace],
        speed_gains: list[float],
        priorities: list[int],
        ellipses: Ellipses = None,
    ) -> None:
        self._solver: Final = solver
        self._targets_um: Final = [target_um for _, _, target_um in places[:-1]]
        self._speed_gains: Final = speed_gains
        self._priorities: Final = priorities
        rules = [np.array(SOLVED_DISC), np.array(JUDGED_DISC)]
        self._weights: Final = [np.ascontiguousarray(rule[:, 2]) for rule in rules]
        self._shapes: Final = [solver.shapes(rule, places, ellipses) for rule in rules]
        self._allowed_jnd: list[float] = []
        self._calls = 0  # for each friction

    def interval(self, calls: int) -> tuple[float, float] | None:
        """Return the lowest and the highest friction in reach, as a target has it (0 .. 1), by at most so many calls of
        the solver, LEAST_CALLS or more; None where none is."""
        without_jnd = self._solved(self._targets_um, self._silence(0))[1] if self._targets_um else []
        self._allowed_jnd = [*[max(MISSED_JND, abs(error_jnd) + SLACK_JND) for error_jnd in without_jnd], MISSED_JND]
        self._calls = min((calls - 2 * COLD) // TRIED, MOST_CALLS)
        state, passed, is_good = self._silence(1), list[_State](), list[bool]()
        for step in range(STEPS + 1):
            state, is_felt = self._tried(1.0 - step / STEPS, state)
            passed.append(state)
            is_good.append(is_felt)
        first, last = _longest_run(is_good)
        return None if first > last else (self._edge(last, 1, passed), self._edge(first, -1, passed))

    def _edge(self, step: int, outwards: int, passed: list[_State]) -> float:
        """Bisect between the last step in reach and the first beyond it."""
        inside = 1.0 - step / STEPS
        if not 0 <= step + outwards <= STEPS:
            return inside
        beyond, state = 1.0 - (step + outwards) / STEPS, passed[step]
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + beyond)
            tried, is_felt = self._tried(middle, state)
            if is_felt:
                inside, state = middle, tried
            else:
                beyond = middle
        return inside

    def _tried(self, friction_frac: float, state: _State) -> tuple[_State, bool]:
        """Return the state where this finger is asked to feel a friction, and whether all feel what they may."""
        targets_um = [*self._targets_um, self._solver.curve.amplitude_um(friction_frac) * self._speed_gains[-1]]
        for _ in range(self._calls):
            state, errors_jnd = self._solved(targets_um, state)
            if all(abs(errors_jnd[n]) <= self._allowed_jnd[n] for n in range(len(errors_jnd))):
                return state, True
        return state, False

    def _silence(self, own: int) -> _State:
        return (0j,) * len(self._solver.limits_um), [0.0] * (len(self._targets_um) + own)

    def _solved(self, targets_um: list[float], state: _State) -> tuple[_State, list[float]]:
        """Return the state after one call for the first fingers, which have these targets, and their errors there."""
        count, limits_um, curve = len(targets_um), self._solver.limits_um, self._solver.curve
        shapes, judged = (of_all[: count * len(of_all) // len(self._speed_gains)] for of_all in self._shapes)
        table = finger_table(curve, targets_um, state[1], self._speed_gains[:count], self._priorities[:count])
        given, how = (table, curve.table, limits_um), ((math.inf,), self._solver.uncertain_frac, self._solver.even_frac)
        ((modal_um, _),) = descend(shapes, self._weights[0], *given, state[0], ITERATIONS, *how)
        descend(judged, self._weights[1], *given, modal_um, 0, *how)
        return (modal_um, table[5 * count : 6 * count].tolist()), table[6 * count : 7 * count].tolist()


def _longest_run(is_good: list[bool]) -> tuple[int, int]:
    """Return the first and the last index of the longest run; the last is before the first where there is none."""
    best, start = (0, -1), 0
    for index in range(len(is_good)):
        if not is_good[index]:
            start = index + 1
        elif index - start > best[1] - best[0]:
            best = start, index
    return best
