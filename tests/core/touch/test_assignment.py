"""The assignment against every permutation, and against scipy for a full hand."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from hapticd.core.touch.assignment import least_cost_assignment

costs_mm = st.one_of(st.integers(0, 3).map(float), st.floats(-50.0, 200.0))
small_matrices = st.tuples(st.integers(1, 4), st.integers(1, 4)).flatmap(
    lambda shape: st.lists(
        st.lists(costs_mm, min_size=shape[1], max_size=shape[1]), min_size=shape[0], max_size=shape[0]
    )
)


def total(costs: list[list[float]], pairs: list[tuple[int, int]]) -> float:
    return sum(costs[row][column] for row, column in pairs)


def cheapest_by_trying_all(costs: list[list[float]]) -> float:
    matrix = np.asarray(costs)
    if matrix.shape[0] > matrix.shape[1]:
        matrix = matrix.T
    rows, columns = matrix.shape
    return min(sum(matrix[i, j] for i, j in enumerate(order)) for order in permutations(range(columns), rows))


@settings(max_examples=300)
@given(small_matrices)
def test_no_permutation_is_cheaper_and_every_row_and_column_is_used_at_most_once(costs: list[list[float]]) -> None:
    pairs = least_cost_assignment(costs)
    assert abs(total(costs, pairs) - cheapest_by_trying_all(costs)) < 1e-9
    assert len(pairs) == min(len(costs), len(costs[0]))
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    assert pairs == sorted(pairs)


def test_a_full_hand_agrees_with_scipy() -> None:
    rng = np.random.default_rng(7)
    for shape in ((15, 15), (15, 11), (4, 16)):
        matrix = rng.uniform(0.0, 100.0, shape)
        rows, columns = linear_sum_assignment(matrix)
        costs = matrix.tolist()
        assert abs(total(costs, least_cost_assignment(costs)) - matrix[rows, columns].sum()) < 1e-9
