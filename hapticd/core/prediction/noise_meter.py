"""Noise of a pad's positions, measured on the positions of a moving finger.

From third differences of regular samples: a parabola has none, and the jerk of a hand adds a tenth of the noise's share
(0.007 mm at 5 m/s^3 and 11 ms, where white noise of 0.05 mm gives 0.22). The median ignores the few large ones of a
start or stop. Source: von Neumann et al., The Mean Square Successive Difference, Annals of Mathematical Statistics 12
(1941), extended to the third order and made robust.
"""

from __future__ import annotations

import math
from typing import Final

from ..rolling_quantile import RollingQuantile

_LEAST_SAMPLES: Final = 64  # fewer are less accurate than the expected noise
_LONGEST_PERIODS: Final = 1.5  # after a lost sample the differences restart
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
        """Restart the differences, because the next sample is not a period after the last; keep the measured noise."""
        self._seen = 0
        self._axes = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # x of the last three samples, then y

    def update(self, x_mm: float, y_mm: float, periods: float) -> None:
        """Take a sample, `periods` of the pad's period after the previous one.

        Differences of zero are ignored: pads repeat the counts of a resting finger exactly.
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

    def noise_mm(self, default_mm: float) -> float:
        """Return the measured noise, or `default_mm` while the samples are too few."""
        if len(self._lengths) < _LEAST_SAMPLES:
            return default_mm
        return self._lengths.value / (_UNITS_PER_MM * _MEDIAN_OF_UNIT_NOISE)
