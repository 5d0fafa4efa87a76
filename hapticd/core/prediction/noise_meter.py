"""How noisy a pad's positions are, found from the positions themselves while the finger moves.

Third differences of regular samples: a parabola has none, and what a hand's jerk leaves of them is a tenth of the
noise's share (0.007 mm at 5 m/s^3 and 11 ms, where white noise of 0.05 mm gives 0.22). Their median size ignores the
few that a start or a stop makes large. Source: von Neumann et al., The Mean Square Successive Difference, Annals of
Mathematical Statistics 12 (1941), carried to the third order and made robust.
"""

from __future__ import annotations

import math
from typing import Final

from ..rolling_quantile import RollingQuantile

_LEAST_SAMPLES: Final = 64  # fewer tell less than what is known of pads beforehand
_LONGEST_PERIODS: Final = 1.5  # after a lost sample differences begin anew
# Of a third difference (1, -3, 3, -1) of unit noise: variance 1 + 9 + 9 + 1 on each axis; its length over both axes is
# Rayleigh's, of median sqrt(2 ln 2).
_MEDIAN_OF_UNIT_NOISE: Final = math.sqrt(20.0 * 2.0 * math.log(2.0))
_UNITS_PER_MM: Final = 1e9


class NoiseMeter:
    """The standard error of one position on one axis, over the last `samples` of a touch."""

    __slots__ = ("_axes", "_lengths", "_seen")

    def __init__(self, samples: int) -> None:
        self._lengths = RollingQuantile(samples, 0.5)
        self.restart()

    def restart(self) -> None:
        """The samples to come do not follow regularly on those before; what was found stays."""
        self._seen = 0
        self._axes = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # x of the last three samples, then y

    def update(self, x_mm: float, y_mm: float, periods: float) -> None:
        """Take a sample that came `periods` of the pad's period after the one before it.

        A difference of zero is left out: pads repeat a resting finger's counts exactly, which tells nothing.
        """
        if periods > _LONGEST_PERIODS:
            self.restart()
        x1, x2, x3, y1, y2, y3 = self._axes
        self._axes = x_mm, x1, x2, y_mm, y1, y2
        self._seen += 1
        if self._seen > 3:
            length_mm = math.hypot(x_mm - x3 - 3.0 * (x1 - x2), y_mm - y3 - 3.0 * (y1 - y2))
            if length_mm > 0.0:
                self._lengths.push(int(length_mm * _UNITS_PER_MM))

    def noise_mm(self, otherwise_mm: float) -> float:
        """What the samples say, or `otherwise_mm` while they are too few."""
        if len(self._lengths) < _LEAST_SAMPLES:
            return otherwise_mm
        return self._lengths.value / (_UNITS_PER_MM * _MEDIAN_OF_UNIT_NOISE)
