"""Baseline predictors by name, beside the default: the same intake, another motion model."""

from __future__ import annotations

from ...core.prediction.predictor import DEFAULT, Predictor, PredictorFactory
from .kalman_models import (
    KalmanConstantAcceleration,
    KalmanConstantJerk,
    KalmanConstantVelocity,
    KalmanSinger,
)
from .motion_models import (
    AlphaBeta,
    AlphaBetaGamma,
    DoubleExponential,
    Hold,
    LeastSquares,
    Linear,
    OneEuroLinear,
)

PREDICTORS: dict[str, PredictorFactory] = {
    "default": DEFAULT,
    "hold": PredictorFactory.of(Hold),
    "linear": PredictorFactory.of(Linear),
    "alpha_beta": PredictorFactory.of(AlphaBeta),
    "alpha_beta_gamma": PredictorFactory.of(AlphaBetaGamma),
    "double_exponential": PredictorFactory.of(DoubleExponential),
    "one_euro_linear": PredictorFactory.of(OneEuroLinear),
    "least_squares": PredictorFactory.of(LeastSquares),
    "kalman_cv": PredictorFactory.of(KalmanConstantVelocity),
    "kalman_ca": PredictorFactory.of(KalmanConstantAcceleration),
    "kalman_singer": PredictorFactory.of(KalmanSinger),
    "kalman_jerk": PredictorFactory.of(KalmanConstantJerk),
}


def make_predictor(name: str = "default", **settings: float) -> Predictor:
    """Return a predictor for one touch by name; ValueError names what is valid."""
    factory = PREDICTORS.get(name)
    if factory is None:
        raise ValueError(f"Unknown predictor {name!r}: choose from {', '.join(sorted(PREDICTORS))}.")
    return factory(**settings)
