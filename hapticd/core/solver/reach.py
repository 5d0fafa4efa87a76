"""The reach of one finger: the interval of friction that it can feel beside the others with their targets.

A friction is in reach if the solver for friction (`felt`) finds amplitudes with which this finger feels it, within a
just noticeable difference, and every other finger what it asked for, within one, or as well as without this finger.
From bare glass to the most slippery, each of a few frictions is solved for from the solution of the one before; then
both ends of the longest run in reach are bisected. What is felt is judged by more points of the contacts than the
solver's: where large amplitudes cancel, these miss up to a just noticeable difference. A solve may be cut off before
it has converged, because its time is limited: what is said to be in reach is, and a little more may be.
"""

from __future__ import annotations

from typing import Final

from ..friction import FrictionCurve
from ..plate.contact import Shapes
from .felt import (
    COLD_ITERATIONS,
    ITERATIONS,
    MISSED_JND,
    STAY_FRAC,
    UNCERTAIN_FRAC,
    counted_jnd,
    solve_felt,
    stickiness,
)
from .felt_descent import descend

STEPS: Final = 8  # between bare glass and the most slippery
HALVINGS: Final = 4  # of each end: to 0.008
MOST_CALLS: Final = 12  # of the solver for a friction; more find hardly more
COLD_CALLS: Final = COLD_ITERATIONS // ITERATIONS
TRIED: Final = STEPS + 1 + 2 * HALVINGS  # frictions
LEAST_CALLS: Final = 2 * (COLD_CALLS + TRIED)
SLACK_JND: Final = 0.02  # by which another finger may miss more than without this one


class ReachProblem:
    """The other fingers and this one, the last: shapes at the points of each contact (N, Q, M), of these `weights`
    (Q,), and at those by which it is judged; targets (N - 1,) and how much more amplitude each needs as it slides, and
    its priority (N,)."""

    __slots__ = (
        "curve",
        "judged_shapes",
        "judged_weights",
        "limits_um",
        "priorities",
        "shapes",
        "stretches",
        "targets_um",
        "weights",
    )

    def __init__(
        self,
        shapes: Shapes,
        weights: list[float],
        judged_shapes: Shapes,
        judged_weights: list[float],
        curve: FrictionCurve,
        targets_um: list[float],
        limits_um: tuple[float, ...],
        stretches: list[float],
        priorities: list[int],
    ) -> None:
        self.shapes: Final = shapes
        self.weights: Final = weights
        self.judged_shapes: Final = judged_shapes
        self.judged_weights: Final = judged_weights
        self.curve: Final = curve
        self.targets_um: Final = targets_um
        self.limits_um: Final = limits_um
        self.stretches: Final = stretches
        self.priorities: Final = priorities


class _State:
    """Where a search is: amplitudes and the fingers' weights."""

    __slots__ = ("d_um", "logs", "q_um")

    def __init__(self, d_um: list[float], q_um: list[float], logs: list[float]) -> None:
        self.d_um, self.q_um, self.logs = d_um, q_um, logs

    def copy(self) -> _State:
        return _State(self.d_um.copy(), self.q_um.copy(), self.logs.copy())


def reach(problem: ReachProblem, calls: int) -> tuple[float, float] | None:
    """Return the lowest and the highest friction in reach, as a target has it (0 .. 1), by at most so many calls of the
    solver, LEAST_CALLS or more; None where none is."""
    allowed_jnd = _allowed_jnd(problem)
    each = min((calls - 2 * COLD_CALLS) // TRIED, MOST_CALLS)
    state = _at_rest(problem, len(problem.stretches))
    passed: list[_State] = []
    is_good: list[bool] = []
    for step in range(STEPS + 1):
        is_good.append(_is_felt(problem, 1.0 - step / STEPS, state, allowed_jnd, each))
        passed.append(state.copy())
    first, last = _longest_run(is_good)
    if first > last:
        return None
    high = _edge(problem, first, -1, passed, allowed_jnd, each)
    low = _edge(problem, last, 1, passed, allowed_jnd, each)
    return low, high


def _edge(
    problem: ReachProblem, step: int, outwards: int, passed: list[_State], allowed_jnd: list[float], each: int
) -> float:
    """Bisect between the last step in reach and the first beyond it."""
    inside = 1.0 - step / STEPS
    if not 0 <= step + outwards <= STEPS:
        return inside
    beyond, state = 1.0 - (step + outwards) / STEPS, passed[step]
    for _ in range(HALVINGS):
        middle, tried = 0.5 * (inside + beyond), state.copy()
        if _is_felt(problem, middle, tried, allowed_jnd, each):
            inside, state = middle, tried
        else:
            beyond = middle
    return inside


def _is_felt(problem: ReachProblem, friction_frac: float, state: _State, allowed_jnd: list[float], calls: int) -> bool:
    """Move the state to where this finger is asked to feel a friction, by at most so many calls; return whether all
    feel what they may."""
    own_um = problem.curve.amplitude_um(friction_frac) * problem.stretches[-1]
    for _ in range(calls):
        errors_jnd = _solved(problem, [*problem.targets_um, own_um], state)
        is_felt = True
        for finger in range(len(errors_jnd)):
            is_felt = is_felt and abs(errors_jnd[finger]) <= allowed_jnd[finger]
        if is_felt:
            return True
    return False


def _allowed_jnd(problem: ReachProblem) -> list[float]:
    """Return by how much each finger may miss: a just noticeable difference, or what it misses without this one."""
    others = len(problem.targets_um)
    if others == 0:
        return [MISSED_JND]
    errors_jnd = _solved(problem, problem.targets_um, _at_rest(problem, others))
    return [*[max(MISSED_JND, abs(error_jnd) + SLACK_JND) for error_jnd in errors_jnd], MISSED_JND]


def _at_rest(problem: ReachProblem, fingers: int) -> _State:
    modes = len(problem.limits_um)
    return _State([0.0] * modes, [0.0] * modes, [0.0] * fingers)


def _solved(problem: ReachProblem, targets_um: list[float], state: _State) -> list[float]:
    """Move the state by one call for the first fingers, which have these targets; return their errors there."""
    count, fingers = len(targets_um), len(problem.stretches)
    curve, stretches, priorities = problem.curve, problem.stretches[:count], problem.priorities[:count]
    shapes = problem.shapes[: count * len(problem.shapes) // fingers]
    targets, weights, limits_um = tuple(targets_um), problem.weights, problem.limits_um
    solve_felt(shapes, weights, curve, targets, limits_um, state.d_um, state.q_um, state.logs, stretches, priorities)
    frictions = [curve.friction(targets[n] / stretches[n]) for n in range(len(targets))]
    there, floor = state.copy(), (curve.full_um, curve.floor_frac)
    errors_jnd, _ = descend(
        problem.judged_shapes[: count * len(problem.judged_shapes) // fingers],
        problem.judged_weights,
        targets_um,
        frictions,
        counted_jnd(frictions, priorities),
        stickiness(frictions),
        stretches,
        curve.pieces,
        floor,
        limits_um,
        there.d_um,
        there.q_um,
        there.logs,
        1,
        STAY_FRAC,
        UNCERTAIN_FRAC,
    )
    return errors_jnd


def _longest_run(is_good: list[bool]) -> tuple[int, int]:
    """Return the first and the last index of the longest run; the last is before the first where there is none."""
    best, start = (0, -1), 0
    for index in range(len(is_good)):
        if not is_good[index]:
            start = index + 1
        elif index - start > best[1] - best[0]:
            best = start, index
    return best
