"""Solver: fingers' targets to modal amplitudes within the limits (paper, eq. 1-3)."""

from .public import solve, solve_batch

__all__ = ["solve", "solve_batch"]
