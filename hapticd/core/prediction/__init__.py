"""Finger prediction: one predictor per touch, its precomputed gains and its noise meter."""

from .predictor import make_predictor

__all__ = ["make_predictor"]
