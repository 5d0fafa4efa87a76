"""What is known of a pad before it is touched: the distribution of the corrections' weights over many devices.

From public recordings of real touches: zhaorz/Touch-Calculator, whot/evemu-devices, bentiss/hid-devices,
interactionlab/MobileHCI17-Touch-Extrapolation and others, 132 000 samples of 40 devices, and the synthetic motions of
`bench/motions` as 18 devices more, so that a pad of white noise is not forgotten. For each device the normal equations
of its corrections were summed as the predictor forms them; the prior is the normal distribution of the devices'
weights, by expectation maximisation (empirical Bayes; Dempster, Laird, Rubin 1977), where 20 neighbouring samples count
as one. The spreads are medians over the devices of 68 % quantiles.
"""

from __future__ import annotations

from typing import Final, NamedTuple

MotionVector = tuple[float, float, float, float, float]
Spreads = tuple[tuple[float, ...], tuple[float, ...]]


class Prior(NamedTuple):
    """A normal distribution: its mean, and the inverse of its covariance by rows."""

    mean: MotionVector
    precision: tuple[MotionVector, MotionVector, MotionVector, MotionVector, MotionVector]


NEAR: Final = Prior(
    (-0.0338721, 0.100796, 1.36776, -0.47556, 0.521582),
    (
        (1072.3, 3.54525, 40.8981, 15.3229, -15.8362),
        (3.54525, 9.07174, 0.905827, 0.598389, -1.43149),
        (40.8981, 0.905827, 4.72699, 2.11084, -2.70726),
        (15.3229, 0.598389, 2.11084, 1.348, -0.78711),
        (-15.8362, -1.43149, -2.70726, -0.78711, 4.11951),
    ),
)

FAR: Final = Prior(
    (-0.0509109, 0.182597, 2.26636, -1.55334, 0.536177),
    (
        (571.166, 7.74706, 18.6196, 7.6117, -0.502112),
        (7.74706, 21.4252, 1.89781, 1.55545, 1.52172),
        (18.6196, 1.89781, 1.61779, 0.818618, -0.03327),
        (7.6117, 1.55545, 0.818618, 0.524009, 0.286304),
        (-0.502112, 1.52172, -0.03327, 0.286304, 2.15345),
    ),
)

# Along and across the motion, at both horizons, by class of speed.
SPREADS_MM: Final[tuple[Spreads, Spreads]] = (
    (
        (0.0226, 0.0756, 0.11, 0.16, 0.2, 0.313, 0.454, 0.64, 2.92),
        (0.00583, 0.0351, 0.05, 0.063, 0.0903, 0.114, 0.15, 0.164, 0.175),
    ),
    (
        (0.0541, 0.152, 0.245, 0.36, 0.439, 0.627, 0.901, 1.33, 5.84),
        (0.0133, 0.0608, 0.0938, 0.136, 0.203, 0.252, 0.322, 0.336, 0.421),
    ),
)
