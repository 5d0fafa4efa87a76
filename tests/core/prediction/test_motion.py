"""The motion models, each on the motion that it knows exactly, and against its twin in another form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.bench.baselines.kalman_models import (
    KalmanConstantAcceleration,
    KalmanConstantJerk,
    KalmanConstantVelocity,
    KalmanSinger,
)
from hapticd.bench.baselines.motion_models import (
    AlphaBeta,
    AlphaBetaGamma,
    DoubleExponential,
    Hold,
    LeastSquares,
    Linear,
    OneEuroLinear,
)
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
    """A report is lost now and then."""
    steps = [2 * PERIOD_S if k % 7 == 3 else PERIOD_S for k in range(samples)]
    return np.cumsum(steps).tolist()


@pytest.mark.parametrize(
    "model",
    [
        Linear(),
        AlphaBeta(),
        AlphaBeta(fading=0.6),
        AlphaBetaGamma(),
        KalmanConstantVelocity(),
        KalmanConstantAcceleration(),
        KalmanSinger(),
        KalmanConstantJerk(),
        LeastSquares(),
        ModelBank(period_ms=11.25),
    ],
    ids=lambda model: type(model).__name__,
)
def test_a_straight_line_is_continued_exactly(model: MotionModel) -> None:
    t_s = irregular_times(200)
    feed(model, t_s, [3.0 + 80.0 * t for t in t_s], [-60.0 * t for t in t_s])
    ahead_s = t_s[-1] + 0.015
    assert model.position(0.015) == pytest.approx((3.0 + 80.0 * ahead_s, -60.0 * ahead_s), abs=2e-3)
    assert model.velocity(0.015) == pytest.approx((80.0, -60.0), abs=0.2)


@pytest.mark.parametrize(
    "model",
    [LeastSquares(), AlphaBetaGamma(), KalmanConstantAcceleration(), KalmanConstantJerk(damping=1.0)],
    ids=lambda model: type(model).__name__,
)
def test_a_parabola_is_continued_exactly(model: MotionModel) -> None:
    t_s = irregular_times(100)
    feed(model, t_s, [20.0 * t - 150.0 * t * t for t in t_s], [90.0 * t * t for t in t_s])
    t = t_s[-1] + 0.020
    assert model.position(0.020) == pytest.approx((20.0 * t - 150.0 * t * t, 90.0 * t * t), abs=1e-6)


def test_least_squares_is_the_weighted_fit_of_numpy() -> None:
    rng = np.random.default_rng(2)
    t_s = irregular_times(8)
    x, y = rng.normal(size=8), rng.normal(size=8)
    model = feed(LeastSquares(window_ms=25.0), t_s, x.tolist(), y.tolist())
    ages = np.array(t_s) - t_s[-1]
    root_weights = np.exp(ages / 0.025 / 2.0)  # numpy squares its weights
    expected = [np.polyval(np.polyfit(ages, axis, 2, w=root_weights), 0.012) for axis in (x, y)]
    assert model.position(0.012) == pytest.approx(expected, abs=1e-9)


def test_two_samples_make_a_line_for_least_squares_too() -> None:
    model = feed(LeastSquares(), [0.0, 0.01], [0.0, 1.0], [5.0, 5.0])
    assert model.position(0.01) == pytest.approx((2.0, 5.0), abs=1e-12)


def test_double_exponential_smoothing_is_the_alpha_beta_filter_with_equal_fading() -> None:
    """Brown's smoothing and the fading-memory line are one filter on regular samples, once the start is forgotten."""
    rng = np.random.default_rng(8)
    t_s = [k * PERIOD_S for k in range(80)]
    x, y = np.cumsum(rng.normal(size=80)).tolist(), np.cumsum(rng.normal(size=80)).tolist()
    smoothed = feed(DoubleExponential(smoothing=0.7), t_s, x, y)
    filtered = feed(AlphaBeta(fading=0.3), t_s, x, y)
    assert smoothed.position(0.02) == pytest.approx(filtered.position(0.02), abs=1e-9)


def test_without_fading_alpha_beta_is_the_line_through_two_samples() -> None:
    rng = np.random.default_rng(4)
    t_s = irregular_times(30)
    x, y = rng.normal(size=30).tolist(), rng.normal(size=30).tolist()
    assert feed(AlphaBeta(fading=0.0), t_s, x, y).position(0.015) == pytest.approx(
        feed(Linear(), t_s, x, y).position(0.015), abs=1e-9
    )


def test_one_euro_smooths_at_rest_and_follows_in_motion() -> None:
    rng = np.random.default_rng(6)
    t_s = [k * PERIOD_S for k in range(400)]
    model = OneEuroLinear()
    model.start(0.0, 0.0)
    at_rest = []
    for _ in t_s:
        noisy = 0.01 * rng.standard_normal(2)
        model.step(Sample(PERIOD_S, PERIOD_S, *noisy.tolist()))
        at_rest.append(model.position(0.0))
    assert np.std(np.array(at_rest)[50:]) < 0.007
    feed(model, t_s, [200.0 * t for t in t_s], [0.0 for _ in t_s])
    assert model.velocity(0.0)[0] == pytest.approx(200.0, rel=1e-6)
    assert model.position(0.0)[0] == pytest.approx(200.0 * t_s[-1], abs=0.1)


def test_hold_holds() -> None:
    assert feed(Hold(), [0.0, 0.01], [0.0, 1.0], [0.0, 2.0]).position(0.05) == (1.0, 2.0)


def test_a_kalman_filter_of_little_trust_in_its_sensor_smooths_more() -> None:
    rng = np.random.default_rng(1)
    x, y = (0.05 * rng.standard_normal((2, 300))).tolist()

    def spread(noise_mm: float) -> float:
        model = KalmanConstantAcceleration(noise_mm=noise_mm)
        model.start(x[0], y[0])
        seen = []
        for k in range(1, 300):
            model.step(Sample(PERIOD_S, PERIOD_S, x[k], y[k]))
            seen.append(math.hypot(*model.position(0.015)))
        return float(np.mean(seen))

    assert spread(0.5) < 0.8 * spread(0.05)


def test_the_bank_changes_from_rest_to_motion_and_back_without_a_long_memory() -> None:
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


def test_a_kalman_filter_of_constant_acceleration_is_singer_s_whose_acceleration_never_fades() -> None:
    rng = np.random.default_rng(9)
    t_s = irregular_times(100)
    x, y = np.cumsum(rng.normal(size=100)).tolist(), np.cumsum(rng.normal(size=100)).tolist()
    settings = {"jerk_density_mm2_s5": 3e7, "noise_mm": 0.05}
    plain = feed(KalmanConstantAcceleration(**settings), t_s, x, y)
    slow = feed(KalmanSinger(**settings, manoeuvre_s=1e6, damping=1.0), t_s, x, y)
    quick = feed(KalmanSinger(**settings, manoeuvre_s=0.05, damping=1.0), t_s, x, y)
    assert slow.position(0.02) == pytest.approx(plain.position(0.02), abs=1e-4)
    assert quick.position(0.02) != pytest.approx(plain.position(0.02), abs=1e-2)


@pytest.mark.parametrize(
    ("model", "order", "density"),
    [
        (KalmanConstantVelocity(acceleration_density_mm2_s3=2e4, noise_mm=0.06), 2, 2e4),
        (KalmanConstantAcceleration(jerk_density_mm2_s5=2e7, noise_mm=0.06), 3, 2e7),
        (KalmanConstantJerk(snap_density_mm2_s7=2e9, noise_mm=0.06, damping=1.0), 4, 2e9),
    ],
    ids=["velocity", "acceleration", "jerk"],
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


def test_the_bank_follows_a_circle_nearer_than_a_filter_of_constant_acceleration() -> None:
    """What the models of constant jerk are for: radius 20 mm at 30 cm/s, without noise only the lag is left."""
    t_s = [k * PERIOD_S for k in range(120)]
    x, y = [20.0 * math.cos(15.0 * t) for t in t_s], [20.0 * math.sin(15.0 * t) for t in t_s]
    ahead = 15.0 * (t_s[-1] + 0.015)
    truth = 20.0 * math.cos(ahead), 20.0 * math.sin(ahead)
    bank = feed(ModelBank(period_ms=11.25), t_s, x, y)
    single = feed(KalmanConstantAcceleration(), t_s, x, y)
    assert math.dist(bank.position(0.015), truth) < 0.5 * math.dist(single.position(0.015), truth)
