"""The friction law: the friction that an amplitude gives at a sliding speed, and the amplitude for a friction.

One curve, measured (`hapticd calibrate friction`) or built in, serves targets, solver, perception, score, design and
view. Between its knots the logarithm of friction falls straight with amplitude: equal parts of the way are equally many
just noticeable differences, and two knots are an exponential.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from ..values import FloatArray

FLOOR_FRAC: Final = 0.057  # friction at 2 um of the built-in curve, relative to bare glass


class FrictionCurve:
    """Friction against amplitude through (friction_frac, amplitude_um) knots.

    Friction 1 is bare glass, so the last knot is (1, 0); friction 0 is the most slippery the plate can usefully do:
    `floor_frac` of bare glass's. The amplitude falls strictly from knot to knot. A finger that gains at `speed_mm_s`
    needs twice the amplitude of one at rest, for any friction; at inf, speed changes nothing. Raises ValueError
    otherwise.
    """

    def __init__(
        self,
        knots: tuple[tuple[float, float], ...],
        floor_frac: float = FLOOR_FRAC,
        speed_mm_s: float = math.inf,
    ) -> None:
        _check(knots, floor_frac, speed_mm_s)
        self.knots: Final = knots
        self.floor_frac: Final = floor_frac
        self.speed_mm_s: Final = speed_mm_s
        self.full_um: Final = knots[0][1]  # where the floor begins
        rising = [(amplitude_um, self._relative(friction)) for friction, amplitude_um in reversed(knots)]
        self._starts_um: Final = [amplitude_um for amplitude_um, _ in rising[:-1]]
        self._decays_um: Final = [_decay_um(*pair) for pair in pairwise(rising)]
        self._origins_um: Final = [
            start_um + decay_um * math.log(relative)  # where the piece's exponential is 1
            for (start_um, relative), decay_um in zip(rising[:-1], self._decays_um, strict=True)
        ]
        ends = [self.full_um, floor_frac]
        rates_1_um = [1.0 / decay_um for decay_um in self._decays_um]
        self.table: Final = np.array(ends + self._starts_um + self._origins_um + rates_1_um)  # of `felt_descent`

    @classmethod
    def from_amplitudes(
        cls, amplitudes_um: Sequence[float], floor_frac: float = FLOOR_FRAC, speed_mm_s: float = math.inf
    ) -> FrictionCurve:
        """Amplitudes at equally spaced frictions 1 .. 0, as a calibration sweeps them: rising from 0 um."""
        last = len(amplitudes_um) - 1
        if last < 1:
            raise ValueError("friction curve: needs two or more amplitudes.")
        knots = tuple([(1.0 - index / last, float(amplitudes_um[index])) for index in range(last, -1, -1)])
        return FrictionCurve(knots, floor_frac, speed_mm_s)

    @classmethod
    def exponential(cls, full_um: float = 2.0, decay_um: float = 0.7, speed_mm_s: float = math.inf) -> FrictionCurve:
        """Friction that decays exponentially with amplitude, reaching its floor at `full_um`.

        The fast-then-slow fall is what is measured on vibrating glass (Biet, Giraud and Lemaire-Semail 2007;
        Wiertlewski, Fenton Friesen and Colgate 2016). The two numbers are only a start: fingers, glass and
        frequency change them, so calibrate before trusting a friction value.
        """
        return FrictionCurve(((0.0, full_um), (1.0, 0.0)), math.exp(-full_um / decay_um), speed_mm_s)

    def amplitude_um(self, friction_frac: float) -> float:
        """The amplitude for a friction; beyond 0 .. 1 that of the nearer end, for NaN 0 um."""
        if not friction_frac < 1.0:
            return 0.0
        if friction_frac <= 0.0:
            return self.full_um
        right = bisect_right(self.knots, friction_frac, key=lambda knot: knot[0])
        (friction, amplitude_um), (next_friction, next_amplitude_um) = self.knots[right - 1 : right + 1]
        if friction == friction_frac:
            return amplitude_um
        whole = math.log(self._relative(friction) / self._relative(next_friction))
        share = math.log(self._relative(friction) / self._relative(friction_frac)) / whole
        return amplitude_um * (1.0 - share) + next_amplitude_um * share

    def friction(self, amplitude_um: float, sliding_mm_s: float = 0.0) -> float:
        """The friction that an amplitude gives, relative to that of bare glass; the inverse of `amplitude_um`."""
        at_um = amplitude_um / self.speed_gain(sliding_mm_s)
        if not at_um < self.full_um:
            return self.floor_frac
        if at_um <= 0.0:
            return 1.0
        piece = self._piece(at_um)
        return math.exp(-(at_um - self._origins_um[piece]) / self._decays_um[piece])

    def friction_frac(self, relative: float) -> float:
        """A friction relative to bare glass's as targets count it: 0 is the most slippery, 1 bare glass."""
        return max((relative - self.floor_frac) / (1.0 - self.floor_frac), 0.0)

    def decay_um(self, amplitude_um: float) -> float:
        """The friction over its slope at an amplitude of a finger at rest; beyond the floor that of the last piece."""
        return self._decays_um[self._piece(amplitude_um)]

    def speed_gain(self, sliding_mm_s: float) -> float:
        """By how much more amplitude a finger needs at this speed than at rest."""
        return 1.0 + sliding_mm_s / self.speed_mm_s

    def frictions(self, amplitude_um: FloatArray, sliding_mm_s: FloatArray | float = 0.0) -> FloatArray:
        """`friction` of arrays that broadcast."""
        at_um = np.maximum(amplitude_um / (1.0 + sliding_mm_s / self.speed_mm_s), 0.0)
        piece = self._pieces(at_um)
        falling = np.exp(-(at_um - np.array(self._origins_um)[piece]) / np.array(self._decays_um)[piece])
        return np.asarray(np.where(at_um < self.full_um, falling, self.floor_frac) + 0.0 * at_um)

    def _piece(self, at_um: float) -> int:
        piece = 0
        while piece + 1 < len(self._starts_um) and at_um >= self._starts_um[piece + 1]:
            piece += 1
        return piece

    def _pieces(self, at_um: FloatArray) -> npt.NDArray[np.intp]:
        return np.asarray(np.searchsorted(self._starts_um[1:], at_um, side="right"))

    def _relative(self, friction_frac: float) -> float:
        """Return a friction of 0 .. 1 relative to bare glass's."""
        return self.floor_frac + (1.0 - self.floor_frac) * friction_frac


def _decay_um(left: tuple[float, float], right: tuple[float, float]) -> float:
    if not left[1] > right[1]:  # by rounding
        raise ValueError("friction curve: from knot to knot friction must rise.")
    return (right[0] - left[0]) / math.log(left[1] / right[1])


def _check(knots: tuple[tuple[float, float], ...], floor_frac: float, speed_mm_s: float) -> None:
    if not (0.0 < floor_frac < 1.0 and speed_mm_s > 0.0):
        raise ValueError("friction curve: its floor must be above 0 and below 1, and its speed above 0.")
    if not all(math.isfinite(friction) and math.isfinite(amplitude) for friction, amplitude in knots):
        raise ValueError("friction curve: every knot needs two finite numbers, friction and amplitude.")
    if len(knots) < 2 or knots[0][0] != 0.0 or knots[-1] != (1.0, 0.0):
        raise ValueError("friction curve: knots must run from friction 0 to friction 1, where it is 0 um.")
    for (friction, amplitude), (next_friction, next_amplitude) in pairwise(knots):
        if not (friction < next_friction and amplitude > next_amplitude):
            raise ValueError("friction curve: from knot to knot friction must rise and amplitude must fall.")


DEFAULT_FRICTION_CURVE: Final = FrictionCurve.exponential()
