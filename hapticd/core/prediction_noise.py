"""How noisy a pad's positions are, found from the positions themselves while the finger moves.

Third differences of regular samples: a parabola has none, and what a hand's jerk leaves of them is a tenth of the
noise's share (0.007 mm at 5 m/s^3 and 11 ms, where white noise of 0.05 mm gives 0.22). Their median size ignores the
few that a start or a stop makes large. Source: von Neumann et al., The Mean Square Successive Difference, Annals of
Mathematical Statistics 12 (1941), carried to the third order; the median of absolute values for a normal's deviation.
"""

from __future__ import annotations

import math

from .rolling_quantile import RollingQuantile

_LEAST_SAMPLES = 64  # fewer tell less than what is known of pads beforehand
_LONGEST_PERIODS = 1.5  # after a lost sample differences begin anew
# Of a third difference (1, -3, 3, -1) of unit noise: variance 1 + 9 + 9 + 1; the median size of a normal is 0.6745.
_MEDIAN_OF_UNIT_NOISE = 0.6745 * math.sqrt(20.0)
_UNITS_PER_MM = 1e9


class NoiseMeter:
    """The standard error of one position on one axis, over the last `samples` of a touch."""

    __slots__ = ("_axes", "_seen", "_sizes")

    def __init__(self, samples: int) -> None:
        self._sizes = RollingQuantile(2 * samples, 0.5)
        self.restart()

    def restart(self) -> None:
        """The samples to come do not follow regularly on those before; what was found stays."""
        self._seen = 0
        self._axes = (0.0,) * 6

    def update(self, x_mm: float, y_mm: float, periods: float) -> None:
        """Take a sample that came `periods` of the pad's period after the one before it."""
        if periods > _LONGEST_PERIODS:
            self.restart()
        x1, x2, x3, y1, y2, y3 = self._axes
        self._axes = x_mm, x1, x2, y_mm, y1, y2
        self._seen += 1
        if self._seen > 3:
            self._note(x_mm - x3 - 3.0 * (x1 - x2))
            self._note(y_mm - y3 - 3.0 * (y1 - y2))

    def noise_mm(self, otherwise_mm: float) -> float:
        """What the samples say, or `otherwise_mm` while they are too few."""
        if len(self._sizes) < 2 * _LEAST_SAMPLES:
            return otherwise_mm
        return self._sizes.value / (_UNITS_PER_MM * _MEDIAN_OF_UNIT_NOISE)

    def _note(self, difference_mm: float) -> None:
        """A zero is left out: pads repeat a resting finger's counts exactly, which says nothing of their noise."""
        if difference_mm != 0.0:
            self._sizes.push(int(abs(difference_mm) * _UNITS_PER_MM))
