"""What the chosen parts are compared with: predictors, solver policies and the paper's scheme, as plain Python."""

from .predictors import PREDICTORS, make_predictor
from .solver import solve

__all__ = ["PREDICTORS", "make_predictor", "solve"]
