"""Friction of a contact: the mean over it of the friction curve at the plate's amplitude, and its uncertainty.

Friction has a cusp wherever the amplitude is 0, which only many points resolve.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ..values import FloatArray
from .friction import FrictionCurve
from .phasors import Phasors
from .plate.bicubic import POINT
from .plate.contact import JUDGED_DISC, ContactEllipse, disc_points
from .plate.mode_shapes import ModeShapes
from .plate.splines import perceive
from .uncertainty import CERTAIN, COVERED_SIGMAS, Uncertainty, interval_um


class ExpectedAmplitude(NamedTuple):
    """An RMS amplitude that is to be expected, and the interval in which it is in nine of ten cases."""

    rms_um: float
    low_um: float
    high_um: float


class Felt(NamedTuple):
    """The mean friction over a contact relative to bare glass, its interval, and the contact's amplitude."""

    friction: float
    low: float
    high: float
    amplitude: ExpectedAmplitude


class ContactPerception:
    """Frictions of contacts by one friction curve: discs of one radius, 0 for points, and ellipses. Errors of plate,
    sensors and pad are expected by their `uncertainty`."""

    def __init__(self, curve: FrictionCurve, radius_mm: float, uncertainty: Uncertainty = CERTAIN) -> None:
        self.curve: Final = curve
        self.uncertainty = uncertainty
        self.radius_mm = radius_mm
        self._many: Final = np.array(JUDGED_DISC)
        self._few: Final = np.array(disc_points(1.0))

    def felt(
        self,
        modes: ModeShapes,
        x_mm: float,
        y_mm: float,
        modal_um: Phasors,
        speed_gain: float,
        place_mm2: float = 0.0,
        ellipse: ContactEllipse | None = None,
    ) -> Felt:
        """Return what is felt over a contact whose place has this variance on each axis.

        `modal_um` (M,) moves the plate; a sliding finger needs `speed_gain` times the amplitude of one at rest;
        without an `ellipse` the contact is a disc.
        """
        friction, amplitude = self._expected(self._many, modes, x_mm, y_mm, modal_um, speed_gain, place_mm2, ellipse)
        friction = min(friction, 1.0)  # rounding may add to bare glass's
        rms_um, low_um, high_um = amplitude
        curve_um = COVERED_SIGMAS * self.uncertainty.curve_frac * rms_um
        low_um = rms_um - math.hypot(rms_um - low_um, curve_um)
        high_um = rms_um + math.hypot(high_um - rms_um, curve_um)
        per = friction / self.curve.friction(rms_um / speed_gain)  # as the curve changes between these amplitudes
        low, high = per * self.curve.friction(high_um / speed_gain), per * self.curve.friction(low_um / speed_gain)
        return Felt(friction, min(low, friction), min(max(high, friction), 1.0), amplitude)

    def amplitude(
        self,
        modes: ModeShapes,
        x_mm: float,
        y_mm: float,
        modal_um: Phasors,
        place_mm2: float,
        ellipse: ContactEllipse | None = None,
    ) -> ExpectedAmplitude:
        """Return the amplitude over a contact, or at a point, whose place has this variance on each axis."""
        return self._expected(self._few, modes, x_mm, y_mm, modal_um, 1.0, place_mm2, ellipse)[1]

    def asked(self, target_um: float, speed_gain: float) -> float:
        """Return the friction that an amplitude asks for: that of the same amplitude all over the contact."""
        return self.curve.friction(target_um / speed_gain)

    def _expected(
        self,
        disc: FloatArray,
        modes: ModeShapes,
        x_mm: float,
        y_mm: float,
        modal_um: Phasors,
        speed_gain: float,
        place_mm2: float,
        ellipse: ContactEllipse | None,
    ) -> tuple[float, ExpectedAmplitude]:
        """Return the friction and the amplitude over a contact, at the points of a rule for the unit disc."""
        xx_mm, xy_mm, yy_mm = (self.radius_mm, 0.0, self.radius_mm) if ellipse is None else ellipse
        size_mm2 = xx_mm * yy_mm - xy_mm * xy_mm
        if place_mm2 > 0.0:  # the mean over all places where it may be
            if size_mm2 > 0.0:
                grown = math.sqrt(1.0 + 4.0 * place_mm2 / size_mm2)
                xx_mm, xy_mm, yy_mm = grown * xx_mm, grown * xy_mm, grown * yy_mm
            else:
                xx_mm = yy_mm = 2.0 * math.sqrt(place_mm2)
            size_mm2 += 4.0 * place_mm2
        over, contact, unsure = disc if size_mm2 > 0.0 else POINT, (x_mm, y_mm, xx_mm, xy_mm, yy_mm), self.uncertainty
        friction, known_um2, errors_um2, mean_d_um, mean_q_um = perceive(
            modes.tables, over, contact, modal_um, self.curve.table, speed_gain, unsure.map_frac, unsure.sensors_frac
        )
        unsure_um2 = errors_um2
        if place_mm2 > 0.0:  # place^2 |gradient|^2 is that share of what varies over the contact
            varies_um2 = known_um2 - (mean_d_um * mean_d_um + mean_q_um * mean_q_um)
            unsure_um2 += 4.0 * place_mm2 / size_mm2 * max(varies_um2, 0.0)
        low_um, high_um = interval_um(max(known_um2 + errors_um2 - unsure_um2, 0.0), unsure_um2)
        return friction, ExpectedAmplitude(math.sqrt(known_um2 + errors_um2), low_um, high_um)
