"""The alternatives that the chosen parts are measured against: predictors and the paper's scheme."""

from .predictors import PREDICTORS, make_predictor

__all__ = ["PREDICTORS", "make_predictor"]
