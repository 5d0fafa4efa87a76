"""Solver policies of the bench: each against what defines it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

import hapticd.core.solver as core_solver
from hapticd.bench.baselines import solve
from hapticd.bench.baselines.solver import POLICIES

Array = npt.NDArray[np.float64]

LIMIT_UM = 4.0


def reachable(phi: Array, served: Array, row: Array, limit: float) -> tuple[float, float]:
    """The least and greatest amplitude of a finger while those before it keep theirs."""
    equal = {"A_eq": phi[: len(served)], "b_eq": served} if len(served) else {}
    ends = [linprog(sign * row, bounds=[(-limit, limit)] * len(row), **equal).fun for sign in (1.0, -1.0)]
    return ends[0], -ends[1]


def served_in_order(phi: Array, target_um: Array, limit: float, served: tuple[float, ...] = ()) -> tuple[float, ...]:
    """The amplitudes' misses, least in the order of the rows, over every choice of signs that ties."""
    index = len(served)
    if index == len(phi):
        return ()
    low, high = reachable(phi, np.array(served), phi[index], limit)
    values = {max(low, min(high, sign * target_um[index])) for sign in (1.0, -1.0)}
    missed = {value: abs(abs(value) - target_um[index]) for value in values}
    least = min(missed.values())
    ways = [value for value in values if missed[value] <= least + 1e-12]
    return (least, *min(served_in_order(phi, target_um, limit, (*served, value)) for value in ways))


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10**6), fingers=st.integers(1, 4), modes=st.integers(1, 4))
def test_priority_serves_each_finger_as_well_as_those_before_it_allow(seed: int, fingers: int, modes: int) -> None:
    random = np.random.default_rng(seed)
    phi = random.uniform(-1, 1, (fingers, modes))
    target_um = random.uniform(0.1, 4.0, fingers) * (random.random(fingers) < 0.7)
    solution = solve(phi, target_um, 2.0, policy="priority")
    assert np.all(np.abs(solution.modal_um) <= 2.0)
    missed = np.abs(solution.achieved_um - target_um)
    assert missed == pytest.approx(served_in_order(phi, target_um, 2.0), abs=1e-6)


@pytest.mark.parametrize("policy", POLICIES)
def test_every_policy_breaks_no_limit_and_makes_no_exception_of_singular_positions(policy: str) -> None:
    random = np.random.default_rng(7)
    for phi in (np.full((2, 2), 0.5), np.zeros((2, 3)), random.uniform(-1, 1, (3, 2)), random.uniform(-1, 1, (4, 4))):
        for reach_um in (1.0, 1e12):
            target_um = reach_um * np.arange(float(len(phi)))
            solution = solve(phi, target_um, LIMIT_UM, policy=policy, previous_um=np.ones(phi.shape[1]))
            assert np.all(np.abs(solution.modal_um) <= LIMIT_UM)


def test_keep_zero_without_weights_is_the_core_s() -> None:
    phi = np.random.default_rng(1).uniform(-1, 1, (3, 3))
    ours = core_solver.solve(phi, [1.0, 0.5, 0.0], LIMIT_UM)
    assert solve(phi, [1.0, 0.5, 0.0], LIMIT_UM).modal_um.tolist() == ours.modal_um.tolist()


def test_keep_ratio_scales_all_fingers_alike() -> None:
    solution = solve([[1.0, 0.3], [0.2, 0.9]], [9.0, 3.0], LIMIT_UM, policy="keep_ratio")
    assert solution.limited
    assert solution.achieved_um[0] == pytest.approx(3 * solution.achieved_um[1])
    assert np.max(np.abs(solution.modal_um)) == pytest.approx(LIMIT_UM)


def test_least_squares_leaks_where_that_serves_the_others_better() -> None:
    phi = np.array([[0.8, 0.75], [0.8, 0.7]])
    traded = solve(phi, [1.0, 0.0], LIMIT_UM, policy="least_squares")
    assert traded.achieved_um[1] > 0.1
    found = lsq_linear(phi, [1.0, 0.0], (-LIMIT_UM, LIMIT_UM), method="bvls").x
    assert np.abs(traded.modal_um) == pytest.approx(np.abs(found))


def test_the_paper_s_policy_is_its_formula() -> None:
    phi = np.array([[0.8, 0.75], [0.8, 0.7]])
    inverse = np.linalg.solve(phi, [1.0, 0.0])
    solution = solve(phi, [1.0, 0.0], LIMIT_UM, policy="paper")
    assert solution.modal_um == pytest.approx(inverse * LIMIT_UM / np.max(np.abs(inverse)))
    assert solution.limited


def test_effort_shrinks_the_amplitude_as_its_formula_says() -> None:
    gain = 0.6
    modal_um = solve([[gain, 0.0], [0.0, 1.0]], [2.0, 0.0], 9.0, effort=0.3).modal_um
    assert np.abs(modal_um) == pytest.approx([2.0 * gain / (gain * gain + 0.3), 0.0])


@pytest.mark.parametrize("target_um", [1.0, 6.0], ids=["tie in |W|", "tie in the error, at the limits"])
def test_hysteresis_holds_a_sign_pattern_through_a_near_tie(target_um: float) -> None:
    largest_step_um = []
    for hysteresis in (0.0, 0.05):
        modal_um = [solve([[1.0, 0.2], [0.2, -1.0]], [target_um] * 2, LIMIT_UM).modal_um]
        for wobble in (0.003, -0.003) * 10:
            phi = [[1.0, 0.2 + wobble], [0.2, -1.0]]
            solution = solve(phi, [target_um] * 2, LIMIT_UM, hysteresis=hysteresis, previous_um=modal_um[-1])
            modal_um.append(solution.modal_um)
        largest_step_um.append(np.abs(np.diff(modal_um[1:], axis=0)).max())
    assert largest_step_um[0] > 1.0
    assert largest_step_um[1] < 0.02


def test_an_unknown_policy_is_one_sentence() -> None:
    with pytest.raises(ValueError, match=r"^policy: 'best' is unknown; choose one of keep_zero, [^\n]*\.$"):
        solve([[0.5]], [1.0], LIMIT_UM, policy="best")
