"""Pictures and arrays as maps, over the whole plate or so many millimetres wide."""

from __future__ import annotations

import os
from typing import Any

from hapticd_contract.contents import MAX_ASSET_SIDE
from hapticd_contract.surfaces import Rectangle

from ..errors import RefusedError
from .score import Layer

LIGHT_IS_SLIPPERY = (1.0, 0.0)  # friction of black and of white


def layer_of(
    source: Any,
    *,
    high_um: float | None = None,
    low_um: float = 0.0,
    frictions: tuple[float, float] | None = None,
    width_mm: float | None = None,
) -> Layer:
    """Return a layer of a picture file, or of an array: rows of levels 0 .. 255 from the top (+y) down.

    Level 255, white, is `high_um` and black `low_um`; or `frictions` are those of black and white, by default 1 and 0.
    Without `width_mm` the middle square of a picture, or the array, is spread over the whole plate. Raises
    RefusedError, HapticdError without Pillow.
    """
    if isinstance(source, (str, os.PathLike)):
        from ..image import grey_rows

        source = grey_rows(source, MAX_ASSET_SIDE, is_square=width_mm is None)
    if high_um is None and frictions is None:
        frictions = LIGHT_IS_SLIPPERY
    content = {"frictions": frictions} if frictions is not None else {"high_um": high_um, "low_um": low_um}
    shape = None
    if width_mm is not None:
        try:
            shape = Rectangle(width_mm, width_mm * len(source) / len(source[0]))
        except (TypeError, IndexError, ZeroDivisionError):
            raise RefusedError("map: must have rows of numbers, such as a two-dimensional array.") from None
    return Layer(content, shape, levels=source)
