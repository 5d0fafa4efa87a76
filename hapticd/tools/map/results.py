"""What the maps of `hapticd plate map` share of their output."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...regular_file import opened
from ...values import FloatArray

if TYPE_CHECKING:
    from ...core.plate.mode_shapes import ModeShapes


def plate_line(modes: ModeShapes, size_mm: tuple[float, float], limit_um: Sequence[float]) -> str:
    """Return the plate in words."""
    limits = ", ".join(f"{limit:.3g}" for limit in limit_um)
    named = "1 mode" if modes.M == 1 else f"{modes.M} modes"
    return f"a plate of {size_mm[0]:g} x {size_mm[1]:g} mm, {named} of at most {limits} um"


def save(arrays: dict[str, FloatArray], limit_um: Sequence[float], path: Path) -> None:
    """Write arrays and the limits."""
    with opened(path) as file:
        np.savez_compressed(file, limit_um=np.array(limit_um), **arrays)  # type: ignore[arg-type]
    print(f"written: {path}", file=sys.stderr)
