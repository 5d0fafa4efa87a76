"""The motion models, each on the motion that it describes exactly, and against the books' matrices."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.bench.baselines.predictors import KalmanConstantJerk, KalmanConstantVelocity
from hapticd.core.prediction.bank import ModelBank
from hapticd.core.prediction.gains import process_model
from hapticd.core.prediction.motion import MotionModel, Sample

PERIOD_S = 0.01125


def feed(model: MotionModel, t_s: list[float], x_mm: list[float], y_mm: list[float]) -> MotionModel:
    model.start(x_mm[0], y_mm[0])
    for k in range(1, len(t_s)):
        model.step(Sample(t_s[k] - t_s[k - 1], PERIOD_S, x_mm[k], y_mm[k]))
    return model


def irregular_times(samples: int) -> list[float]:
    """Every seventh report is lost."""
    steps = [2 * PERIOD_S if k % 7 == 3 else PERIOD_S for k in range(samples)]
    return np.cumsum(steps).tolist()


@pytest.mark.parametrize(
    ("model", "order", "density"),
    [
        (KalmanConstantVelocity(acceleration_density_mm2_s3=2e4, noise_mm=0.06), 2, 2e4),
        (KalmanConstantJerk(snap_density_mm2_s7=2e9, noise_mm=0.06, damping=1.0), 4, 2e9),
    ],
    ids=["velocity", "jerk"],
)
def test_each_kalman_filter_is_the_matrix_recursion_of_the_books(
    model: MotionModel, order: int, density: float
) -> None:
    rng = np.random.default_rng(5)
    t_s = irregular_times(40)
    x, y = np.cumsum(rng.normal(size=(2, 40)), axis=1).tolist()
    feed(model, t_s, x, y)
    state, covariance = np.zeros(order), np.diag([0.06**2, 1e4, 1e5, 1e7][:order])
    state[0] = x[0]
    for k in range(1, 40):
        transition, process = process_model(t_s[k] - t_s[k - 1], density, order)
        state, covariance = transition @ state, transition @ covariance @ transition.T + process
        gain = covariance[:, 0] / (covariance[0, 0] + 0.06**2)
        state, covariance = state + gain * (x[k] - state[0]), covariance - np.outer(gain, covariance[0])
    assert model.position(0.0)[0] == pytest.approx(state[0], abs=1e-6)
    assert model.velocity(0.0)[0] == pytest.approx(state[1], rel=1e-6, abs=1e-6)


def test_the_bank_changes_from_rest_to_motion_and_back_within_eight_samples() -> None:
    bank = ModelBank(period_ms=11.25)
    bank.start(0.0, 0.0)
    for _ in range(500):
        bank.step(Sample(PERIOD_S, PERIOD_S, 0.0, 0.0))
    assert bank.velocity(0.0) == (0.0, 0.0)
    for k in range(1, 9):
        bank.step(Sample(PERIOD_S, PERIOD_S, 2.0 * k, 0.0))
    assert bank.velocity(0.0)[0] == pytest.approx(2.0 / PERIOD_S, rel=0.1)
    for _ in range(8):
        bank.step(Sample(PERIOD_S, PERIOD_S, 16.0, 0.0))
    assert abs(bank.velocity(0.0)[0]) < 5.0
    assert bank.position(0.015)[0] == pytest.approx(16.0, abs=0.1)
