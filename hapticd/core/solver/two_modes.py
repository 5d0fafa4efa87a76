"""The paper's case in closed form: two fingers as points on two modes, one slipping, one still.

W lies on the line (phi_Y, -phi_X) of the still finger, limited along it (paper, section IV.B): it gets 0. Of the
line's two sides that of the present amplitudes is taken, or their phase. All is scaled down where amplitude costs the
still finger more than it gives the other, near singular positions:

    price   a position is never known to better than a tenth of a millimetre. Of an error e the still finger feels
            e |grad w|, although w is exactly zero at the predicted position. Of all amplitudes that give the slipping
            finger the same mean, those cost the least whose share of the target is in proportion to |grad w|^2.
    slew    where the still finger crosses a common node of the modes any amplitudes are zero there, and those that
            stay so change sign at once. Zero all the way takes |dW/dP| >= |grad w| / |phi|, um per mm of its way.
"""

from __future__ import annotations

import math
from typing import Final

from ..plate.mode_shapes import ModeShapes

Pair = tuple[float, float]

NOISE: Final = 8 * 2.0**-52  # a sum of products below this share of its terms is rounding, not signal
SAFE: Final = 1e100  # squares of larger numbers, or of their inverses, leave the range of floats
DERATING_MM2_UM2: Final = 5.0  # least share of its target for a slipping finger, per slope of 1 um/mm under a still one
STEEPEST_UM_MM: Final = 4.0  # of the reference along a still finger's way: a step of 1.5 um from knot to knot
LEAST_SHARE: Final = 0.3  # a share falls to 0 and rises again within a knot or two: following it fully makes steps


def clamped(value: float, limit: float) -> float:
    """Clamp a value to +-limit; NaN becomes 0."""
    if -limit <= value <= limit:
        return value
    return math.copysign(limit, value) if value == value else 0.0


def hold_still(
    slipping: Pair, target: float, still: Pair, limits: Pair, previous: tuple[complex, complex]
) -> tuple[Pair, complex, bool]:
    """Return real W, the phase by which to turn it to the present amplitudes, and `limited`.

    The still finger must be on no common node. Zeros in `previous` leave sign and phase free. Shapes that are not
    finite give silence.
    """
    (x, y), (limit_x, limit_y) = still, limits
    if abs(y) >= abs(x) and 0.0 < abs(y) < math.inf:
        ux, uy = 1.0, -x / y
        slope = abs(uy)
        top = limit_y / slope if slope * limit_x > limit_y else limit_x
    elif 0.0 < abs(x) < math.inf:
        ux, uy = -y / x, 1.0
        slope = abs(ux)
        top = limit_x / slope if slope * limit_y > limit_x else limit_y
    else:
        return (0.0, 0.0), 1.0 + 0j, False
    first, second = slipping[0] * ux, slipping[1] * uy
    gain = first + second
    size = abs(gain)
    if not NOISE * (abs(first) + abs(second)) < size < math.inf:
        return (0.0, 0.0), 1.0 + 0j, False
    wanted = target / size
    t = wanted if wanted <= top else top
    lean, behind = (previous[0].real * ux + previous[1].real * uy), (previous[0].imag * ux + previous[1].imag * uy)
    phase, ahead = 1.0 + 0j, math.hypot(lean, behind)
    if behind != 0.0 and 0.0 < ahead < SAFE:
        phase = complex(lean / ahead, behind / ahead)
    elif lean < 0.0 or (lean == 0.0 and gain < 0.0):
        t = -t
    return (clamped(t * ux, limit_x), clamped(t * uy, limit_y)), phase, not wanted <= top


def turned(modal: Pair, phase: complex, limits: Pair) -> tuple[complex, complex]:
    """Return real W turned by a phase, within the limits to the last bit."""
    if phase.imag == 0.0:
        return complex(modal[0], 0.0), complex(modal[1], 0.0)
    one, other, shave = modal[0] * phase, modal[1] * phase, 2.0**-53
    while abs(one) > limits[0] or abs(other) > limits[1]:  # both: the still finger stays still
        one, other, shave = one * (1.0 - shave), other * (1.0 - shave), 2.0 * shave
    return one, other


def derated(
    modal: Pair, share: float, still: Pair, modes: ModeShapes, place: tuple[float, float, float], *, limited: bool
) -> Pair:
    """Return W scaled by 1 or less: `share` is what the slipping finger gets of its target, `still` are the shapes at
    `place` under the other one."""
    square = still[0] * still[0] + still[1] * still[1]
    largest_um_mm = modes.steepest_1_mm() * (abs(modal[0]) + abs(modal[1]))
    if not (limited or square * STEEPEST_UM_MM**2 < largest_um_mm * largest_um_mm):
        return modal
    along_x = along_y = 0.0
    for w_um, (_, dx_1_mm, dy_1_mm) in zip(modal, modes.at_with_gradient(place[0], place[1]), strict=True):
        along_x += dx_1_mm * w_um
        along_y += dy_1_mm * w_um
    slope_um_mm, bound_um_mm, scale = math.hypot(along_x, along_y), STEEPEST_UM_MM * math.sqrt(square), 1.0
    if slope_um_mm > bound_um_mm:
        scale = bound_um_mm / slope_um_mm
    if limited:
        price, worth = DERATING_MM2_UM2 * slope_um_mm * slope_um_mm, math.hypot(share, LEAST_SHARE)
        if price > worth:
            scale = min(scale, worth / price)
    return modal if scale == 1.0 else (modal[0] * scale, modal[1] * scale)
