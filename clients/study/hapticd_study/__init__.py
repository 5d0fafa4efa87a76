"""Experiments with participants on the plate: sessions and their reports."""

__version__ = "0.2.0"
