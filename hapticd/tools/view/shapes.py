"""The mode shapes as the page draws them: evaluated on an even grid from edge to edge, once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...errors import HapticdError, ModesError

GRID = 101  # points per side: more are drawn no finer, for the browser interpolates between them


def modes_of(body: Mapping[str, Any]) -> ModeShapes:
    """The daemon's map of the plate, from its answer to `plate`. Raises HapticdError where it is none."""
    try:
        x_mm, y_mm = body["x_mm"], body["y_mm"]
        values = np.frombuffer(body["shapes"], "<f4").reshape(body["modes"], len(y_mm), len(x_mm))
        return ModeShapes.from_grid(x_mm, y_mm, values.astype(np.float64))
    except (KeyError, TypeError, ValueError, ModesError) as error:
        raise HapticdError(f"The daemon's answer to `plate` holds no mode shapes ({error}).") from None


def picture_grid(modes: ModeShapes, size_mm: tuple[float, float]) -> bytes:
    """The shapes as float32, little-endian: by mode, by rows from the top (+y) down, by columns from left to right."""
    x_mm = np.linspace(-size_mm[0] / 2, size_mm[0] / 2, GRID)
    y_mm = np.linspace(size_mm[1] / 2, -size_mm[1] / 2, GRID)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return np.ascontiguousarray(modes.evaluate(points_mm).T, dtype="<f4").tobytes()
