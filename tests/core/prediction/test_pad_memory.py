"""What is learned of a pad: weights, spreads, and bounds on both."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.prediction.pad_memory import (
    CLASSES,
    FAR_S,
    MOST_WEIGHT,
    NEAR_S,
    SLOWEST_MM_S,
    HorizonFit,
    PadMemory,
    Spread,
    speed_class,
)
from hapticd.core.prediction.prior import FAR, NEAR, SPREADS_MM, Vector

TRUE = (0.05, 0.5, -0.3, 0.2, 0.4)


def taught(samples: int, noise_mm: float = 0.02, seed: int = 1) -> HorizonFit:
    """A fit that saw corrections of which `TRUE` is the right sum."""
    rng = np.random.default_rng(seed)
    fit = HorizonFit(NEAR)
    for _ in range(samples):
        fx, fy = rng.normal(size=(2, 5))
        dx, dy = fx @ TRUE + noise_mm * rng.normal(), fy @ TRUE + noise_mm * rng.normal()
        fit.learn(tuple(fx.tolist()), tuple(fy.tolist()), float(dx), float(dy))
    return fit


def test_before_anything_is_learned_the_weights_are_the_prior_s() -> None:
    memory = PadMemory()
    assert memory.weights(NEAR_S) == NEAR.mean
    assert memory.weights(FAR_S) == pytest.approx(FAR.mean)
    assert memory.kept == (*NEAR.mean, *FAR.mean)


def test_the_weights_become_those_of_the_pad() -> None:
    assert taught(400).weights == pytest.approx(TRUE, abs=0.02)


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


def test_a_prior_is_a_distribution() -> None:
    for prior in (NEAR, FAR):
        precision = np.array(prior.precision)
        assert precision == pytest.approx(precision.T)
        assert np.linalg.eigvalsh(precision).min() > 0.0
        deviations = np.sqrt(np.diag(np.linalg.inv(precision)))
        assert np.all(np.abs(prior.mean) + deviations < MOST_WEIGHT)
    assert np.array(SPREADS_MM).shape == (2, 2, CLASSES)
    assert np.array(SPREADS_MM).min() > 0.0


def test_between_and_beyond_the_two_horizons_weights_lie_on_a_line_of_limited_length() -> None:
    memory = PadMemory((0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0))
    halfway_s = 0.5 * (NEAR_S + FAR_S)
    assert memory.weights(halfway_s) == pytest.approx((0.5,) * 5)
    assert memory.weights(0.0) == (0.0,) * 5
    assert memory.weights(0.035) == pytest.approx((4.0 / 3.0,) * 5)
    assert memory.weights(0.050) == memory.weights(0.0351)


def test_what_was_kept_of_a_pad_is_where_the_next_memory_begins() -> None:
    memory = PadMemory()
    for _ in range(50):
        memory.near.learn((1.0, 0.2, 0.1, 0.0, 0.3), (0.0, 0.1, 0.0, 0.2, 0.1), 0.1, 0.05)
    later = PadMemory.of(memory.kept)
    assert later.weights(NEAR_S) == memory.near.weights != NEAR.mean
    assert PadMemory.of(()).kept == PadMemory().kept


vectors = st.tuples(*[st.floats(-20.0, 20.0)] * 5)


@given(samples=st.lists(st.tuples(vectors, vectors, st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), max_size=60))
def test_for_any_corrections_the_weights_stay_finite_and_bounded(
    samples: list[tuple[Vector, Vector, float, float]],
) -> None:
    fit = HorizonFit(FAR)
    for sample in samples:
        fit.learn(*sample)
    assert all(abs(weight) <= MOST_WEIGHT for weight in fit.weights)


@pytest.mark.parametrize("sigma_mm", [0.02, 0.3, 2.0])
def test_the_spread_holds_two_thirds_of_the_errors(sigma_mm: float) -> None:
    rng = np.random.default_rng(5)
    spread = Spread(SPREADS_MM[0][0])
    errors_mm, within = (sigma_mm * rng.standard_normal(3000)).tolist(), []
    for error_mm in errors_mm:
        within.append(abs(error_mm) <= spread.at(3))
        spread.learn(3, error_mm)
    assert np.mean(within[300:]) == pytest.approx(0.683, abs=0.02)


def test_a_class_of_speed_is_an_octave() -> None:
    assert [speed_class(SLOWEST_MM_S * factor) for factor in (0.0, 1.0, 1.01, 2.0, 2.01, 4.0)] == [0, 0, 1, 1, 2, 2]
    assert speed_class(1e9) == CLASSES - 1
    assert speed_class(math.inf) == CLASSES - 1
