"""Derating: scale amplitudes down where they cost a still finger more than they give a slipping one.

Two things go wrong near singular positions, where modes at their limits give the slipping finger next to nothing:

    price   a position is never known to better than a tenth of a millimetre. Of an error e the still finger feels
            e |grad w|, although w is exactly zero at the predicted position. Of all amplitudes that give the slipping
            finger the same mean, those cost the least whose share of the target is in proportion to |grad w|^2.
    slew    where the still finger crosses a common node of the modes any amplitudes are zero there, and those that
            stay so change sign at once. Zero all the way takes |dW/dP| >= |grad w| / |phi|, um per mm of its way.

All modes are scaled together, so every zero stays. Left out: the slope of |W| with the slipping finger's way (the floor
of the share bounds it), and still fingers so close to each other that their zeros are one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ..phasors import Row, magnitude, re_im
from ..plate.mode_shapes import ModeShapes

Slope = tuple[float, float, float]  # of one mode at one point: phi, dphi/dx, dphi/dy

STEEPEST_UM_MM: Final = 4.0  # of the reference along a still finger's way: a step of 1.5 um from knot to knot
LEAST_SHARE: Final = 0.3  # a share falls to 0 and rises again within a knot or two: following it fully makes steps


def derated(
    modal_um: Row, share: float, still: Sequence[tuple[Slope, ...]], derating_mm2_um2: float, *, limited: bool
) -> Row:
    """`modal_um` (M,), scaled by 1 or less.

    `share` is the least that a slipping finger gets of its target, `still` the shapes and slopes under each still
    finger. `derating_mm2_um2` is the share required for a slope of 1 um/mm there; it is required only where a limit
    keeps a finger from its target.
    """
    scale = 1.0
    for slopes in still:
        slope_um_mm = _slope_um_mm(slopes, modal_um)
        bound_um_mm = STEEPEST_UM_MM * math.sqrt(_square([phi for phi, _, _ in slopes]))
        if slope_um_mm > bound_um_mm:
            scale = min(scale, bound_um_mm / slope_um_mm)
        if limited:
            price = derating_mm2_um2 * slope_um_mm * slope_um_mm
            worth = math.hypot(share, LEAST_SHARE)
            if price > worth:
                scale = min(scale, worth / price)
    return modal_um if scale == 1.0 else tuple([w_um * scale for w_um in modal_um])


def is_near_node(phi: Sequence[float], modal_um: Row, steepest_1_mm: float) -> bool:
    """A still finger with these shapes (M,) may be so near a common node that the slew could be too great."""
    together_um = 0.0
    for w_um in modal_um:
        w_d_um, w_q_um = re_im(w_um)
        together_um += magnitude(w_d_um, w_q_um)
    largest_um_mm = steepest_1_mm * together_um
    return _square(phi) * STEEPEST_UM_MM**2 < largest_um_mm * largest_um_mm


def least_share(amplitudes_um: Sequence[float], targets_um: Sequence[float]) -> float:
    """The least share of its target that a slipping finger gets; 1 where all are met, or none slips."""
    share = 1.0
    for finger in range(len(targets_um)):
        target_um = targets_um[finger]
        if target_um > 0.0:
            share = min(share, amplitudes_um[finger] / target_um)
    return share


def slopes_at(modes: ModeShapes, places: Sequence[tuple[float, float, float]]) -> list[tuple[Slope, ...]]:
    """Shapes and slopes under the still fingers; `places` are (x_mm, y_mm, target_um)."""
    return [modes.at_with_gradient(x_mm, y_mm) for x_mm, y_mm, target_um in places if target_um == 0.0]


def _slope_um_mm(slopes: Sequence[Slope], modal_um: Row) -> float:
    """|grad w|; of complex amplitudes that of both parts together."""
    along_x_d = along_x_q = along_y_d = along_y_q = 0.0
    for mode in range(len(slopes)):
        _, dx_1_mm, dy_1_mm = slopes[mode]
        w_d_um, w_q_um = re_im(modal_um[mode])
        along_x_d += dx_1_mm * w_d_um
        along_x_q += dx_1_mm * w_q_um
        along_y_d += dy_1_mm * w_d_um
        along_y_q += dy_1_mm * w_q_um
    return math.hypot(magnitude(along_x_d, along_x_q), magnitude(along_y_d, along_y_q))


def _square(phi: Sequence[float]) -> float:
    square = 0.0
    for shape in phi:
        square += shape * shape
    return square
