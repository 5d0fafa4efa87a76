"""Layers: what can be laid over the picture of the field, computed while somebody looks at it.

A layer is a pure function of the plate and of the fingers on it, registered in LAYERS under the name that the page's
menu shows. It answers for each point how well one finger more could get there what the layer is about: 0 not at all,
1 as asked, NaN nothing to say. It is called in a thread, never on the loop; the page asks for it again and again while
it is chosen, and shows no menu where there is none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..core.modes import ModeShapes
from ..errors import RequestError

Array = npt.NDArray[np.float64]

POINTS = 61  # per side: finer than a fingertip


class LayerFinger(NamedTuple):
    """A finger that is wanted, where it is and what it should get."""

    x_mm: float
    y_mm: float
    target_um: float


Layer = Callable[[ModeShapes, Sequence[LayerFinger], Sequence[float], Array], Array]

# name -> layer(modes, fingers, w_limit_um (M,), points_mm (N, 2)) -> (N,)
LAYERS: dict[str, Layer] = {}


def picture(
    name: str, modes: ModeShapes, fingers: Sequence[LayerFinger], w_limit_um: Sequence[float], size_mm: Sequence[float]
) -> bytes:
    """A layer as bytes, by rows from the top (+y) down: 0 .. 254 from none to full, 255 where it says nothing.

    Raises RequestError for a layer that there is not.
    """
    if name not in LAYERS:
        raise RequestError(f"There is no layer {name[:32]!r}.")
    x_mm = np.linspace(-size_mm[0] / 2, size_mm[0] / 2, POINTS)
    y_mm = np.linspace(size_mm[1] / 2, -size_mm[1] / 2, POINTS)
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    values = LAYERS[name](modes, fingers, w_limit_um, points_mm)
    levels = np.clip(np.nan_to_num(values), 0.0, 1.0) * 254.0
    return np.where(np.isnan(values), 255, np.rint(levels)).astype(np.uint8).tobytes()
