"""Layers over the picture of the field: maps of the share of its target that a finger would reach elsewhere.

A layer is computed for one more finger, or for a selected one that could move. It runs in a thread, not on the loop;
the page requests it repeatedly while it is selected.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...design.achievability import MapFinger, achievable_share
from ...errors import RequestError

LAYERS = STICKY, SLIPPERY = "could be sticky", "could be slippery"  # as in the page's menu
POINTS = 81  # per side: finer than a fingertip, and than the valleys of the map
FEW_POINTS, FEWEST_POINTS = 41, 27  # with several slipping fingers the solver must search: on two modes, on more
SLIPPERY_UM = 1.0  # target of one more finger


class LayerFinger(NamedTuple):
    """A finger with a target: its id or name, position and target."""

    key: int | str
    x_mm: float
    y_mm: float
    target_um: float


def picture(
    name: str,
    modes: ModeShapes,
    fingers: Sequence[LayerFinger],
    w_limit_um: Sequence[float],
    size_mm: Sequence[float],
    mover: int | str | None = None,
) -> bytes:
    """Return a layer as bytes, by rows from the top (+y) down: 0 .. 254 from none to full, 255 for no value.

    `mover` is the key of the finger that could move; without it, or if it is gone, the layer is for one more finger.
    Raises RequestError for an unknown layer.
    """
    if name not in LAYERS:
        raise RequestError(f"There is no layer {name[:32]!r}.")
    moving_um = next((finger.target_um for finger in fingers if finger.key == mover), 0.0)
    slipping_um = moving_um if moving_um > 0.0 else SLIPPERY_UM
    others = [MapFinger(*finger[1:]) for finger in fingers if finger.key != mover]
    slipping = sum(finger.target_um > 0.0 for finger in others) + (name == SLIPPERY)
    side = POINTS if slipping < 2 else FEW_POINTS if modes.M == 2 else FEWEST_POINTS
    x_mm = np.linspace(-size_mm[0] / 2, size_mm[0] / 2, side)
    y_mm = np.linspace(size_mm[1] / 2, -size_mm[1] / 2, side)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    values = achievable_share(modes, others, slipping_um if name == SLIPPERY else 0.0, w_limit_um, points_mm)
    levels = np.clip(np.nan_to_num(values), 0.0, 1.0) * 254.0
    return np.where(np.isnan(values), 255, np.rint(levels)).astype(np.uint8).tobytes()
