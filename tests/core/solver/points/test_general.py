"""The general path: null space, sign patterns, limits; against brute force and optimality conditions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from hapticd.core.solver import solve
from hapticd.core.solver.points.polytope import Factored, least_norm_in_polytope

Array = npt.NDArray[np.float64]


def slipping_error(phi: Array, target_um: Array, modal_um: Array) -> float:
    slipping = target_um > 0.0
    missed = np.abs(phi[slipping] @ modal_um) - target_um[slipping]
    return float(missed @ missed)


def most_descent(gradient: Array, at: Array, still: Array, limit: float) -> float:
    """How much a linear objective could still fall inside the limits while the still fingers stay still (an LP)."""
    equal = {"A_eq": still, "b_eq": still @ at} if len(still) else {}
    found = linprog(gradient, bounds=[(-limit, limit)] * len(at), **equal)
    return float(gradient @ at - found.fun)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6), modes=st.integers(1, 6), fingers=st.integers(1, 5), reach=st.sampled_from([1.0, 8.0])
)
def test_no_feasible_direction_lowers_the_error_and_the_zero_holds(
    seed: int, modes: int, fingers: int, reach: float
) -> None:
    """With its signs frozen the problem is convex: at the minimum no feasible point lies downhill."""
    random = np.random.default_rng(seed)
    phi = random.uniform(-1, 1, (fingers, modes))
    target_um = random.uniform(0.2, reach, fingers) * (random.random(fingers) < 0.7)
    solution = solve(phi, target_um, 1.5)
    still, slipping = phi[target_um == 0.0], phi[target_um > 0.0]
    assert np.max(np.abs(still @ solution.modal_um), initial=0.0) < 1e-14
    assert np.all(np.abs(solution.modal_um) <= 1.5)
    given_um = slipping @ solution.modal_um
    wanted = np.copysign(target_um[target_um > 0.0], given_um)
    gradient = 2 * slipping.T @ (given_um - wanted)
    assert most_descent(gradient, solution.modal_um, still, 1.5) < 1e-8


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), modes=st.integers(3, 5), fingers=st.integers(1, 4))
def test_of_all_points_as_good_the_least_is_taken(seed: int, modes: int, fingers: int) -> None:
    """(4): given what the fingers get, no other W within the limits has a smaller norm (gradient test again)."""
    random = np.random.default_rng(seed)
    phi = random.uniform(-1, 1, (fingers, modes))
    solution = solve(phi, random.uniform(0.2, 2.0, fingers), 1.0)
    assert most_descent(2 * solution.modal_um, solution.modal_um, phi, 1.0) < 1e-7


def test_the_local_search_of_many_fingers_ends_where_no_single_sign_helps() -> None:
    random = np.random.default_rng(9)
    phi, target_um = random.uniform(-1, 1, (12, 5)), random.uniform(0.2, 2.0, 12)
    solution = solve(phi, target_um, 2.0, previous_um=random.uniform(-1, 1, 5))
    ours = slipping_error(phi, target_um, solution.modal_um)
    signs = np.sign(phi @ solution.modal_um)
    for index in range(12):
        signs[index] *= -1
        other = lsq_linear(phi, signs * target_um, (-2.0, 2.0), method="bvls").x
        assert ours <= slipping_error(phi, target_um, other) + 1e-9
        signs[index] *= -1


def test_the_active_set_agrees_with_bounded_variable_least_squares() -> None:
    random = np.random.default_rng(10)
    for _ in range(60):
        rows, columns = random.integers(1, 7, 2)
        a, b = random.uniform(-1, 1, (rows, columns)), random.uniform(-3, 3, rows)
        factored = Factored.of(a)
        free = factored.least_norm(b[None])[0]
        z = least_norm_in_polytope(factored, b, free, np.eye(columns), np.ones(columns))
        oracle = lsq_linear(a, b, (-1.0, 1.0), method="bvls").x
        assert np.max(np.abs(z)) <= 1.0 + 1e-12
        assert np.linalg.norm(a @ z - b) <= np.linalg.norm(a @ oracle - b) + 1e-10
