"""A finger that follows a guide over the plate (`design.touch.guide`): strokes around a place, then around the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...design.touch.guide import EACH_S, GUIDED_S, places_at
from ...values import FloatArray
from .real_strokes import RealStrokes

APART_MM = 24.0  # of a quarter's middle from the plate's, along x and y
HALF_SIZE_MM = 34.0  # of the strokes around it: quarters overlap, as with smaller ones less is learned
_MOVE_S = 0.6  # from one place to the next, with least jerk


@dataclass(frozen=True)
class GuidedPath:
    """Strokes of a hand (`RealStrokes`, about the plate's middle) around the places of the first or second finger."""

    strokes: RealStrokes
    is_second: bool
    t_start_s: float

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2)."""
        since_s = np.clip(np.asarray(t_s, np.float64) - self.t_start_s, 0.0, GUIDED_S - 1e-6)
        step = (since_s / EACH_S).astype(np.int64)
        places = [places_at((one + 0.5) * EACH_S)[self.is_second] for one in range(round(GUIDED_S / EACH_S))]
        centre_mm = APART_MM * np.array(places, np.float64)
        part = np.clip((since_s - step * EACH_S) / _MOVE_S, 0.0, 1.0)[:, None]
        way = part**3 * (10.0 - part * (15.0 - 6.0 * part))
        before_mm = centre_mm[np.maximum(step - 1, 0)]
        return self.strokes.position_mm(t_s) + before_mm + way * (centre_mm[step] - before_mm)
