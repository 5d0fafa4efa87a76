"""The simulated plate: firmware C, plate physics and fingers, in lock-step or in real time."""

from .lockstep import Run, Settings, run

__all__ = ["Run", "Settings", "run"]
