"""The true contact of a simulated finger: an ellipse."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...values import FloatArray
from ..score import CONTACT_RADIUS_MM


@dataclass(frozen=True, slots=True)
class Fingertip:
    """A contact of these semi-axes, the major one at `angle_rad` to x."""

    major_mm: float = CONTACT_RADIUS_MM
    minor_mm: float = CONTACT_RADIUS_MM
    angle_rad: float = 0.0

    def ellipses_mm(self, t_s: FloatArray) -> FloatArray:
        """Return the symmetric matrices (T, 2, 2) that make the contact of the unit disc at times (T,)."""
        cosine, sine = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turned = np.array(((cosine, -sine), (sine, cosine)))
        still = (turned * (self.major_mm, self.minor_mm)) @ turned.T
        return np.tile(0.5 * (still + still.T), (len(t_s), 1, 1))

    def pressure_frac(self, t_s: FloatArray) -> FloatArray:
        """Return NaN (T,): the pressure is the pad's own draw."""
        return np.full(len(t_s), np.nan)


USUAL = Fingertip()
