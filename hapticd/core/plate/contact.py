"""A fingertip's contact: a disc or an ellipse, over which a mode's shape varies.

The mean square amplitude over a contact is W^H G W with the Gram matrix G (M, M), the mean of phi_k phi_l over the
contact. It is taken at seven points, the centre and a hexagon at sqrt(2/3) of the radius, whose weights integrate
polynomials up to degree 5 exactly (J. Radon 1948; Abramowitz and Stegun, 25.4.61). On discs of 5 mm contrasts are
within 1 % of those by a Gauss quadrature of 100 points, as are maps of G with a root per pair of modes; both cost more.

A predicted place errs by some sigma on each axis. What is expected over the contact is then the mean over all places
where it may be, and to second order that is a larger disc: the squares of its moments add, a^2 / 4 + sigma^2. An
ellipse grows as the disc of its area does.
"""

from __future__ import annotations

import math
from typing import Final

Disc = list[tuple[float, float, float]]  # points of a contact: dx, dy from its centre, weight
ContactEllipse = tuple[float, float, float]  # xx_mm, xy_mm, yy_mm: the symmetric matrix that makes it of the unit disc
Ellipses = list[ContactEllipse | None] | None  # of fingers (N,), where known; None where all are discs, or points

CENTRE_WEIGHT: Final = 0.25
RIM_WEIGHT: Final = 0.125
RIM_FRAC: Final = math.sqrt(2.0 / 3.0)
RIM_POINTS: Final = 6
# Gauss's nodes on 0 .. 1 with their weights; written out, as numpy.polynomial would stay in the service's memory.
GAUSS: Final = {
    2: ((0.21132486540518713, 0.5), (0.7886751345948129, 0.5)),
    4: (
        (0.06943184420297371, 0.17392742256872692),
        (0.33000947820757187, 0.32607257743127307),
        (0.6699905217924281, 0.32607257743127307),
        (0.9305681557970263, 0.17392742256872692),
    ),
}


def disc_points(radius_mm: float) -> Disc:
    """Return the points of the rule, (dx_mm, dy_mm, weight) about a disc's centre."""
    reach_mm = RIM_FRAC * radius_mm
    turns_rad = [2.0 * math.pi * index / RIM_POINTS for index in range(RIM_POINTS)]
    rim = [(reach_mm * math.cos(turn), reach_mm * math.sin(turn), RIM_WEIGHT) for turn in turns_rad]
    return [(0.0, 0.0, CENTRE_WEIGHT), *rim]


def disc_rule(rings: int, spokes: int) -> Disc:
    """Return points (u, v, weight) of the unit disc: Gauss's rule along the radius squared, the rings turned against
    each other. Friction needs more of them than an RMS: it has a cusp wherever the amplitude is 0."""
    points = []
    for ring in range(rings):
        radius_squared, weight = GAUSS[rings][ring]
        radius = math.sqrt(radius_squared)
        for spoke in range(spokes):
            turn_rad = 2.0 * math.pi * (spoke + 0.5 * (ring % 2)) / spokes
            points.append((radius * math.cos(turn_rad), radius * math.sin(turn_rad), weight / spokes))
    return points


SOLVED_DISC: Final = disc_rule(2, 6)  # for friction as the solver has it
JUDGED_DISC: Final = disc_rule(4, 12)  # and as it is judged
