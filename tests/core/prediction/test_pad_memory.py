"""What is learned of a pad: weights, spreads, and bounds on both."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.prediction.pad_memory import FAR, MOST_WEIGHT, NEAR, HorizonFit, MotionVector, PadMemory

TRUE = (0.05, 0.5, -0.3, 0.2, 0.4)


def test_one_sweep_a_sample_follows_the_exact_solution() -> None:
    """The same sums, solved at once by numpy."""
    rng, fit = np.random.default_rng(3), HorizonFit(NEAR)
    matrix, right, squares, count = np.zeros((5, 5)), np.zeros(5), 0.4, 4.0
    for _ in range(300):
        fx, fy = rng.normal(size=(2, 5))
        d = np.array((fx @ TRUE, fy @ TRUE)) + 0.1 * rng.normal(size=2)
        error = fit.learn(tuple(fx.tolist()), tuple(fy.tolist()), *d.tolist())
        matrix = 0.998 * matrix + np.outer(fx, fx) + np.outer(fy, fy)
        right = 0.998 * right + fx * d[0] + fy * d[1]
        squares, count = 0.998 * squares + 0.5 * float(np.square(error).sum()), 0.998 * count + 1.0
    precision = squares / count * np.array(NEAR.precision)
    exact = np.linalg.solve(matrix + precision, right + precision @ NEAR.mean)
    assert fit.weights == pytest.approx(exact, abs=1e-3)


def test_what_was_kept_of_a_pad_is_where_the_next_memory_begins() -> None:
    memory = PadMemory()
    for _ in range(50):
        memory.near.learn((1.0, 0.2, 0.1, 0.0, 0.3), (0.0, 0.1, 0.0, 0.2, 0.1), 0.1, 0.05)
    later = PadMemory.of(memory.kept)
    assert later.weights(NEAR.ahead_s) == memory.near.weights != NEAR.mean
    assert PadMemory.of(()).kept == PadMemory().kept


vectors = st.tuples(*[st.floats(-20.0, 20.0)] * 5)


@given(samples=st.lists(st.tuples(vectors, vectors, st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), max_size=60))
def test_for_any_corrections_the_weights_stay_finite_and_bounded(
    samples: list[tuple[MotionVector, MotionVector, float, float]],
) -> None:
    fit = HorizonFit(FAR)
    for sample in samples:
        fit.learn(*sample)
    assert all(abs(weight) <= MOST_WEIGHT for weight in fit.weights)
