"""Layers over the picture of the field: maps of the share of its target that a finger would reach elsewhere.

A layer is a pure function of the plate and its fingers, registered in LAYERS under the name in the page's menu. It
returns for each point a share from 0 to 1 of the target, NaN for no value, for one more finger or for a selected one
that could move. A layer runs in a thread, not on the loop; the page requests it repeatedly while it is selected, and
shows no menu without layers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...core.plate.mode_shapes import ModeShapes
from ...design.achievability import Finger, achievable_share
from ...errors import RequestError

Array = npt.NDArray[np.float64]

STICKY, SLIPPERY = "could be sticky", "could be slippery"
POINTS = 81  # per side: finer than a fingertip, and than the valleys of the map
FEW_POINTS, FEWEST_POINTS = 41, 27  # with several slipping fingers the solver must search: on two modes, on more
SLIPPERY_UM = 1.0  # target of one more finger


class LayerFinger(NamedTuple):
    """A finger with a target: its id or name, position and target."""

    key: int | str
    x_mm: float
    y_mm: float
    target_um: float


Layer = Callable[[ModeShapes, Sequence[LayerFinger], LayerFinger | None, Sequence[float], Array], Array]


def _could(
    sticks: bool,
    modes: ModeShapes,
    fingers: Sequence[LayerFinger],
    mover: LayerFinger | None,
    w_limit_um: Sequence[float],
    points_mm: Array,
) -> Array:
    slippery_um = mover.target_um if mover is not None and mover.target_um > 0.0 else SLIPPERY_UM
    others = [Finger(finger.x_mm, finger.y_mm, finger.target_um) for finger in fingers]
    return achievable_share(modes, others, 0.0 if sticks else slippery_um, w_limit_um, points_mm)


# name -> layer(modes, fingers but the mover, mover, w_limit_um (M,), points_mm (N, 2)) -> (N,)
LAYERS: dict[str, Layer] = {STICKY: partial(_could, True), SLIPPERY: partial(_could, False)}


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
    others = [finger for finger in fingers if finger.key != mover]
    slipping = sum(finger.target_um > 0.0 for finger in others) + (name == SLIPPERY)
    side = POINTS if slipping < 2 else FEW_POINTS if modes.M == 2 else FEWEST_POINTS
    x_mm = np.linspace(-size_mm[0] / 2, size_mm[0] / 2, side)
    y_mm = np.linspace(size_mm[1] / 2, -size_mm[1] / 2, side)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    moving = next((finger for finger in fingers if finger.key == mover), None)
    values = LAYERS[name](modes, others, moving, w_limit_um, points_mm)
    levels = np.clip(np.nan_to_num(values), 0.0, 1.0) * 254.0
    return np.where(np.isnan(values), 255, np.rint(levels)).astype(np.uint8).tobytes()
