"""The true contact of a simulated finger: an ellipse."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from ...errors import SimulationError
from ...values import FloatArray
from ..score import CONTACT_RADIUS_MM

MOST_SEMI_MM = 20.0


@dataclass(frozen=True, slots=True)
class Fingertip:
    """A contact of these semi-axes, the major one at `angle_rad` to x."""

    major_mm: float = CONTACT_RADIUS_MM
    minor_mm: float = CONTACT_RADIUS_MM
    angle_rad: float = 0.0

    def __post_init__(self) -> None:
        """Raise SimulationError, a ValueError, for values out of bounds."""
        for name in (field.name for field in fields(self)):
            if not math.isfinite(getattr(self, name)):
                raise SimulationError(f"the fingertip's {name} is {getattr(self, name)}: give a finite number.")
        for name in ("major_mm", "minor_mm"):
            if not 0.0 < getattr(self, name) <= MOST_SEMI_MM:
                raise SimulationError(
                    f"the fingertip's {name} is {getattr(self, name)}: give a semi-axis of at most {MOST_SEMI_MM:g} mm."
                )

    def forms_mm(self, t_s: FloatArray) -> FloatArray:
        """Return the symmetric matrices (T, 2, 2) that make the contact of the unit disc at times (T,)."""
        cosine, sine = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turned = np.array(((cosine, -sine), (sine, cosine)))
        still = (turned * (self.major_mm, self.minor_mm)) @ turned.T
        return np.tile(0.5 * (still + still.T), (len(t_s), 1, 1))

    def pressure_frac(self, t_s: FloatArray) -> FloatArray:
        """Return NaN (T,): the pressure is the pad's own draw."""
        return np.full(len(t_s), np.nan)


USUAL = Fingertip()
