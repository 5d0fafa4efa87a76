"""Warnings about what of a file is not felt on a plate."""

from __future__ import annotations

import warnings


class DroppedWarning(UserWarning):
    """A part of a file that is left out, or felt in another way."""


def drop(what: str) -> None:
    """Warn that something is left out; Python shows a sentence once per place."""
    warnings.warn(f"{what}.", DroppedWarning, stacklevel=3)
