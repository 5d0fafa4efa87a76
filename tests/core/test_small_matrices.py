"""Linear algebra on lists of floats against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.small_matrices import dot, length, normalize, remove, solved


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 8))
def test_a_positive_definite_system_is_solved_from_its_lower_triangle(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    factor = random.normal(size=(count, count + 1))
    matrix, right = factor @ factor.T + 0.01 * np.eye(count), random.normal(size=count)
    found = solved([row[: index + 1] for index, row in enumerate(matrix.tolist())], right.tolist())
    assert found == pytest.approx(np.linalg.solve(matrix, right), rel=1e-8)


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), exponent=st.floats(0.0, 9.0))
def test_what_a_basis_sees_is_removed_to_the_last_bits_in_two_turns(seed: int, exponent: float) -> None:
    random = np.random.default_rng(seed)
    first, other = random.normal(size=(2, 4)).tolist()
    normalize(first)
    vector = [shape + 10.0**-exponent * extra for shape, extra in zip(first, other, strict=True)]
    remove(vector, [first])
    remove(vector, [first])
    assert length(vector) == pytest.approx(float(np.linalg.norm(vector)))
    assert abs(dot(first, vector)) <= 1e-15 * length(vector)
