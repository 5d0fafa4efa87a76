"""The alternatives that the chosen parts are measured against: predictors, rules for points, the paper's scheme."""

from .predictors import PREDICTORS, make_predictor
from .solver import solve

__all__ = ["PREDICTORS", "make_predictor", "solve"]
