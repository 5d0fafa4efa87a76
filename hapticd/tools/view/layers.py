"""Layers: what can be laid over the picture of the field, computed while somebody looks at it.

A layer is a pure function of the plate and of the fingers on it, registered in LAYERS under the name that the page's
menu shows. It answers for each point how well another finger could get there what the layer is about: 0 not at all,
1 as asked, NaN nothing to say. The other finger is one more, or one of those that are there and could go elsewhere. A
layer is called in a thread, never on the loop; the page asks for it again and again while it is chosen, and shows no
menu where there is none.
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
POINTS = 81  # per side: finer than a fingertip, and than the valleys between places that can and cannot
FEW_POINTS, FEWEST_POINTS = 41, 27  # where more than one slips, and the solver has to search: on two modes, and on more
SLIPPERY_UM = 1.0  # what one finger more would ask for


class LayerFinger(NamedTuple):
    """A finger that is wanted: its id or name, where it is and what it should get."""

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
    """A layer as bytes, by rows from the top (+y) down: 0 .. 254 from none to full, 255 where it says nothing.

    `mover` is the key of the finger that could go elsewhere; without, or when it is gone, it is about one finger more.
    Raises RequestError for a layer that there is not.
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
