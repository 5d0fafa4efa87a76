"""Uncertainty of plate, sensors and pad, and of the amplitude over a contact that follows from it.

The plate moves by (phi + its map's errors) (W + the sensors' errors), under a contact whose centre is not quite where
the pad has it. None of these errors is known, but how large they are. With r0 the RMS over the contact by all that is
known, what is to be expected is a sum in quadrature:

    r^2 = r0^2 + map^2 sum_k |W_k|^2 + sensors^2 sum_k |phi_k|^2 sum_l |W_l|^2 + place^2 |gradient|^2

map       standard deviation of each shape at each place, of its peak: its noise, and its change since the scan.
sensors   of each element of the matrix of sensors by modes: gain, phase and crosstalk.
place     of the contact's centre on each axis: the pad's place, its centroid, and along the motion its latency. With
          what the predictor expects of its own error it makes the contact larger (`plate.contact`).
curve     of the amplitude that this person's friction takes, relative: it makes only the friction uncertain.

The errors of a contact are waves as long as the shapes', so that they add to r^2 as few independent numbers do: it is
taken as gamma distributed, of the same mean and variance. In laboratories the interval holds 93 % of the time.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

COVERED_SIGMAS: Final = 1.645  # either way: 90 % of a normal distribution


class Uncertainty(NamedTuple):
    """Standard deviations of what is taken to be known; all 0 for perfect knowledge."""

    map_frac: float = 0.0
    sensors_frac: float = 0.0
    place_mm: float = 0.0
    latency_s: float = 0.0
    curve_frac: float = 0.0

    def place_mm2(self, predicted_mm2: float, speed_mm_s: float) -> float:
        """Return the variance of a contact's place on each axis, of a finger at this speed; `predicted_mm2` is what the
        predictor expects of its own error, NaN if it does not know."""
        known_mm2 = predicted_mm2 if predicted_mm2 > 0.0 else 0.0
        return known_mm2 + self.place_mm**2 + 0.5 * (self.latency_s * speed_mm_s) ** 2


CERTAIN: Final = Uncertainty()


def interval_um(sure_um2: float, unsure_um2: float) -> tuple[float, float]:
    """Return the interval in which an RMS amplitude is in nine of ten cases: `sure_um2` is its square by all that is
    known, `unsure_um2` what is to be expected in addition."""
    mean_um2 = sure_um2 + unsure_um2
    if not (unsure_um2 > 0.0 and mean_um2 > 0.0):
        rms_um = math.sqrt(max(mean_um2, 0.0))
        return rms_um, rms_um
    # The square of a sure phasor and one complex error, taken as a gamma variable: its cube root is nearly normal
    # (E. B. Wilson and M. M. Hilferty, Proc. Nat. Acad. Sci. 17, 1931).
    share = unsure_um2 / mean_um2
    ninth = share * (2.0 - share) / 9.0
    away = COVERED_SIGMAS * math.sqrt(ninth)
    low, high = max(1.0 - ninth - away, 0.0), 1.0 - ninth + away
    return math.sqrt(mean_um2 * low * low * low), math.sqrt(mean_um2 * high * high * high)
