"""Linear algebra on lists of floats against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.small_matrices import solved


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 8))
def test_a_positive_definite_system_is_solved_from_its_lower_triangle(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    factor = random.normal(size=(count, count + 1))
    matrix, right = factor @ factor.T + 0.01 * np.eye(count), random.normal(size=count)
    found = solved([row[: index + 1] for index, row in enumerate(matrix.tolist())], right.tolist())
    assert found == pytest.approx(np.linalg.solve(matrix, right), rel=1e-8)
