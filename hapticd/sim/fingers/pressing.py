"""Pressure of a simulated finger, and the contact that it makes.

A finger that presses harder covers more: by Hertz's law the radius grows with the third root of the force, which is
what a fingertip does between 0.2 and 1 N (50 .. 150 mm2). A pad's pressure is taken for a force of unknown scale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from hapticd_contract.simulated import USUAL_PRESSURE_FRAC, SimulatedTouch

from ...core.plate.contact import ContactEllipse
from ...values import FloatArray
from ..score import CONTACT_RADIUS_MM, TrueContact

LEAST_RADIUS_MM: Final = 3.0
MOST_RADIUS_MM: Final = 8.0  # a finger pad is no larger, however hard it presses

TipSample = tuple[float, float, float, float, float, float]  # x_mm, y_mm, pressure_frac, and the contact's ellipse


class Tip(TrueContact, Protocol):
    """A contact with the plate, and its pressure."""

    def pressure_frac(self, t_s: FloatArray) -> FloatArray:
        """Return the pressure (T,), as a share of the pad's highest; NaN: as the pad draws it for an index finger."""


@dataclass(frozen=True)
class SampledFinger:
    """A path and its tip through samples, straight between them: `at_s` (K,) rising, `rows` (K, 6), each x_mm and y_mm,
    NaN where the finger is lifted, the pressure, and the `ContactEllipse`."""

    at_s: FloatArray
    rows: FloatArray

    @classmethod
    def of(cls, at_s: FloatArray, touches: Sequence[SimulatedTouch]) -> SampledFinger:
        """Return the finger that touches so at each instant."""
        return cls(at_s, np.array([sample_of(touch) for touch in touches]))

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        lines = [np.interp(t_s, self.at_s, along_mm, left=np.nan, right=np.nan) for along_mm in self.rows.T[:2]]
        return np.stack(lines, axis=-1)

    def pressure_frac(self, t_s: FloatArray) -> FloatArray:
        return np.interp(t_s, self.at_s, self.rows[:, 2])

    def ellipses_mm(self, t_s: FloatArray) -> FloatArray:
        ellipses = np.stack([np.interp(t_s, self.at_s, part) for part in self.rows.T[3:]], axis=-1)
        return np.asarray(ellipses[:, (0, 1, 1, 2)].reshape(-1, 2, 2))


@dataclass(frozen=True)
class Repeated:
    """A finger that begins again every `period_s`."""

    finger: SampledFinger
    period_s: float

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        return self.finger.position_mm(np.mod(t_s, self.period_s))

    def pressure_frac(self, t_s: FloatArray) -> FloatArray:
        return self.finger.pressure_frac(np.mod(t_s, self.period_s))

    def ellipses_mm(self, t_s: FloatArray) -> FloatArray:
        return self.finger.ellipses_mm(np.mod(t_s, self.period_s))


def sample_of(touch: SimulatedTouch) -> TipSample:
    """Return the row of a `SampledFinger`."""
    return touch.x_mm, touch.y_mm, touch.pressure_frac, *form_of(touch)


def form_of(touch: SimulatedTouch) -> ContactEllipse:
    """Return the contact of a finger: its ellipse, or the disc that its pressure makes."""
    if touch.major_mm > 0.0:
        return ellipse(touch.major_mm, touch.minor_mm, touch.angle_rad)
    radius_mm = CONTACT_RADIUS_MM * math.cbrt(touch.pressure_frac / USUAL_PRESSURE_FRAC)
    radius_mm = min(max(radius_mm, LEAST_RADIUS_MM), MOST_RADIUS_MM)
    return radius_mm, 0.0, radius_mm


def ellipse(major_mm: float, minor_mm: float, angle_rad: float) -> ContactEllipse:
    """Return the form of a contact with these whole axes, the major one at `angle_rad` to x."""
    mean_mm, half_mm = (major_mm + minor_mm) / 4.0, (major_mm - minor_mm) / 4.0
    along_mm, across_mm = half_mm * math.cos(2.0 * angle_rad), half_mm * math.sin(2.0 * angle_rad)
    return mean_mm + along_mm, across_mm, mean_mm - along_mm
