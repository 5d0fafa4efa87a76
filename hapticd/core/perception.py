"""What a contact feels: the mean over it of the friction curve at the plate's amplitude.

Friction has a cusp wherever the amplitude is 0, which only many points resolve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .friction import FrictionCurve
from .phasors import re_im
from .plate.contact import Disc, EllipseForm
from .plate.mode_shapes import ModeShapes

RINGS_FRAC: Final = (0.0694318442, 0.3300094782, 0.6699905218, 0.9305681558)  # Gauss's nodes, of the radius squared
WEIGHTS: Final = (0.1739274226, 0.3260725774, 0.3260725774, 0.1739274226)
SPOKES: Final = 12


class ContactPerception:
    """Frictions of contacts by one friction curve: discs of one radius, 0 for points, and ellipses."""

    def __init__(self, curve: FrictionCurve, radius_mm: float) -> None:
        self.curve: Final = curve
        self._points: Final = _disc(radius_mm)
        self._disc: Final = _disc(1.0)

    def felt(
        self,
        modes: ModeShapes,
        x_mm: float,
        y_mm: float,
        modal_um: Sequence[complex],
        stretch: float,
        form: EllipseForm | None = None,
    ) -> tuple[float, float]:
        """Return the mean friction over a contact relative to bare glass, and its RMS amplitude.

        `modal_um` (M,) moves the plate; a sliding finger needs `stretch` times the amplitude of one at rest; `form` is
        that of an ellipse.
        """
        friction = square_um2 = 0.0
        parts_um = [re_im(w_um) for w_um in modal_um]
        for dx_mm, dy_mm, weight in self._points if form is None else _formed(self._disc, form):
            row = modes.at(x_mm + dx_mm, y_mm + dy_mm)
            w_d_um = w_q_um = 0.0
            for mode in range(len(row)):
                mode_d_um, mode_q_um = parts_um[mode]
                w_d_um += row[mode] * mode_d_um
                w_q_um += row[mode] * mode_q_um
            size_um2 = w_d_um * w_d_um + w_q_um * w_q_um
            friction += weight * self.curve.friction(math.sqrt(size_um2) / stretch)
            square_um2 += weight * size_um2
        return min(friction, 1.0), math.sqrt(square_um2)  # rounding may add to bare glass's

    def asked(self, target_um: float, stretch: float) -> float:
        """Return the friction that an amplitude asks for: that of the same amplitude all over the contact."""
        return self.curve.friction(target_um / stretch)


def _formed(disc: Disc, form: EllipseForm) -> Disc:
    xx_mm, xy_mm, yy_mm = form
    return [(xx_mm * u + xy_mm * v, xy_mm * u + yy_mm * v, weight) for u, v, weight in disc]


def _disc(radius_mm: float) -> Disc:
    """Return points (dx_mm, dy_mm, weight) of a disc, its rings turned against each other; one point for radius 0."""
    if not radius_mm > 0.0:
        return [(0.0, 0.0, 1.0)]
    points = []
    for ring in range(len(WEIGHTS)):
        reach_mm = radius_mm * math.sqrt(RINGS_FRAC[ring])
        for spoke in range(SPOKES):
            turn_rad = 2.0 * math.pi * (spoke + 0.5 * (ring % 2)) / SPOKES
            points.append((reach_mm * math.cos(turn_rad), reach_mm * math.sin(turn_rad), WEIGHTS[ring] / SPOKES))
    return points
