"""The simulated plate: firmware C, plate physics and fingers, in lock-step or in real time."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .lockstep import Run, run
    from .settings import Settings

__all__ = ["Run", "Settings", "run"]


def __getattr__(name: str) -> object:
    """Import `lockstep` on first use: a daemon that starts a rig needs none of the physics."""
    if name in __all__:
        return getattr(importlib.import_module(".lockstep", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
