"""The alternatives that the chosen parts are measured against: predictors, the paper's scheme, solver policies."""

from .predictors import PREDICTORS, make_predictor
from .solver import solve

__all__ = ["PREDICTORS", "make_predictor", "solve"]
