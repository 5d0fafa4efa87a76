"""Strokes with the statistics of recorded hands: speeds, stops, curvature, corners, and how well they are predicted.

A stroke is a chain of curved minimum-jerk movements (Flash and Hogan, J. Neurosci. 5, 1985) that overlap where the
hand turns gently and come to a stop where it turns sharply (Plamondon's kinematic theory has the same form). `HAND`
holds the distributions that these are drawn from.

How it was fitted: to the statistics (`tests/hand_statistics.py`) of 184 touches, 9002 samples at 125 Hz, of
people who drew figures and letters on an Apple laptop's trackpad (public recordings of zhaorz/Touch-Calculator; no
part of the project). The parameters were searched at random for the least sum of squared relative differences, on four
pairs of fingers for 20 s each, as a pad with `pad_noise.FILTERED_NOISE` reports them. Left out: lifts between strokes,
the slower hands of other devices (touchscreens, tablets: medians of 50 to 110 mm/s), and what people do when they
explore a surface for its feel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from ...values import FloatArray
from .strokes import GAP_MM, HALF_SIZE_MM, TREMOR_MM, Strokes, tremor_mm

_CANDIDATES, _WHOLE = 40, 16  # movements; so many of them in their whole length
_SHORTER = 0.8  # is each of the later ones than the one before
_STEP_S, _BEYOND_S = 0.01, 0.2  # of a movement's instants that are checked, and how far beyond its end
_MARGIN_MM = 0.5  # for what lies between them
_FARTHEST_MM = 1e3  # to leave the bounds is worse than to come close to the other finger
_FIRST_DRAWN_S = 10.0
_MORE_S, _MORE_FRAC = 1.0, 1.02  # drawn at a time: little, as a rig in real time waits for it


class Hand(NamedTuple):
    """Distributions of a hand's movements.

    Length and duration are log-normal about their medians, with deviations (of the logarithm) and the share
    `isochrony` by which a long movement lasts longer. Between two movements the direction changes by a corner of
    `corner_least_deg` or more (in `corner_frac` of the cases; the hand stops, in `rest_frac` of these for a while of
    `rest_s` on average), else by an angle of deviation `turn_deg`, and the movements overlap by up to `overlap_frac`.
    Within a movement the direction changes evenly by an angle of deviation `arc_deg`, and the speed is that of least
    jerk, in the share `flat_frac` a parabola, which starts and stops more abruptly.
    """

    length_mm: float
    length_spread: float
    duration_s: float
    duration_spread: float
    isochrony: float
    corner_frac: float
    corner_least_deg: float
    rest_frac: float
    rest_s: float
    turn_deg: float
    overlap_frac: float
    arc_deg: float
    flat_frac: float


HAND: Final = Hand(
    length_mm=38.87,
    length_spread=1.295,
    duration_s=0.2655,
    duration_spread=0.2085,
    isochrony=0.7369,
    corner_frac=0.1714,
    corner_least_deg=82.56,
    rest_frac=0.1234,
    rest_s=0.09843,
    turn_deg=30.95,
    overlap_frac=0.4604,
    arc_deg=58.58,
    flat_frac=0.4339,
)


@dataclass(frozen=True)
class RealStrokes:
    """Endless strokes of a hand within +-`half_size_mm` of the centre, from `start_mm` at `t_start_s` on.

    With `avoid`, movements are chosen that keep GAP_MM from that finger where possible. There is a tremor as in
    `Strokes`.
    """

    seed: int
    start_mm: tuple[float, float] = (0.0, 0.0)
    t_start_s: float = 0.0
    half_size_mm: float = HALF_SIZE_MM
    avoid: RealStrokes | None = None
    hand: Hand = HAND

    @classmethod
    def like(cls, smooth: Strokes, t_start_s: float) -> RealStrokes:
        """Return a hand that starts where `smooth` is at that time, and avoids the like of what that avoids."""
        x_mm, y_mm = smooth.position_mm(np.array([t_start_s]))[0].tolist()
        avoid = None if smooth.avoid is None else cls.like(smooth.avoid, t_start_s)
        return cls(smooth.seed, (x_mm, y_mm), t_start_s, avoid=avoid)

    @cached_property
    def _table(self) -> _MovementTable:
        return _MovementTable(self)

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        t_s = np.asarray(t_s, dtype=np.float64)
        if not np.all(np.isfinite(t_s)):
            raise ValueError("strokes are defined for finite times only")
        return self._table.position_mm(t_s) + tremor_mm(t_s, TREMOR_MM, self.seed)


class _Movement(NamedTuple):
    """Movements, one per element: along an arc, from direction `from_rad` on by `arc_rad`; `flat_frac` as in `Hand`."""

    t_begin_s: FloatArray
    duration_s: FloatArray
    length_mm: FloatArray
    from_rad: FloatArray
    arc_rad: FloatArray
    flat_frac: FloatArray

    def displacement_mm(self, t_s: FloatArray) -> FloatArray:
        """Return what each has moved (T, 2) by the instants (T,)."""
        part = np.clip((t_s - self.t_begin_s) / self.duration_s, 0.0, 1.0)
        least_jerk, parabola = part**3 * (10 - part * (15 - 6 * part)), part**2 * (3 - 2 * part)
        way = least_jerk + self.flat_frac * (parabola - least_jerk)
        turned_rad = 0.5 * self.arc_rad * way
        chord_mm = self.length_mm * way * np.sinc(turned_rad / math.pi)
        heading_rad = self.from_rad + turned_rad
        return np.asarray(chord_mm[..., None] * np.stack((np.cos(heading_rad), np.sin(heading_rad)), axis=-1))


def _one(*values: float) -> _Movement:
    return _Movement(*(np.array([value]) for value in values))


class _MovementTable:
    """Movements drawn in order from the seed; later times extend the table."""

    def __init__(self, of: RealStrokes) -> None:
        self._of = of
        self._rng = np.random.default_rng([of.seed, 3])
        self._point_mm = np.array(of.start_mm)  # where the last movement ends
        heading_rad = float(self._rng.uniform(-math.pi, math.pi))
        self._drawn = [_one(of.t_start_s - 1e-3, 1e-3, 0.0, heading_rad, 0.0, 0.0)]  # it lands at rest
        self._starts_mm = [self._point_mm]
        self._draw_until(of.t_start_s + _FIRST_DRAWN_S)

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2): the sum of all movements until then, of which two may be under way."""
        latest_s = float(np.max(t_s, initial=0.0))
        if latest_s >= self._columns[0][-1]:
            self._draw_until(max(latest_s + _MORE_S, _MORE_FRAC * latest_s))
        latest = np.maximum(np.searchsorted(self._columns[0], t_s, side="right") - 1, 1)
        before, now = (_Movement(*self._columns[:, which]) for which in (latest - 1, latest))
        return np.asarray(self._start_mm[latest - 1] + before.displacement_mm(t_s) + now.displacement_mm(t_s))

    def _draw_until(self, t_s: float) -> None:
        while self._drawn[-1].t_begin_s[0] <= t_s:
            movement, end_mm = self._draw()
            self._starts_mm.append(self._point_mm)
            self._drawn.append(movement)
            self._point_mm = end_mm
        self._columns = np.concatenate([np.array(movement) for movement in self._drawn], axis=1)
        self._start_mm = np.array(self._starts_mm)

    def _draw(self) -> tuple[_Movement, FloatArray]:
        """Draw the next movement: the first of _CANDIDATES with enough room, or the one with most; later ones are
        shorter."""
        best, best_mm = None, -math.inf
        for tried in range(_CANDIDATES):
            movement = self._random_movement(_SHORTER ** max(tried - _WHOLE, 0))
            room_mm = self._room_mm(movement)
            if best is None or room_mm > best_mm:
                best, best_mm = movement, room_mm
            if room_mm >= 0.0:
                break
        assert best is not None
        return best, self._point_mm + best.displacement_mm(best.t_begin_s + best.duration_s)[0]

    def _random_movement(self, share: float) -> _Movement:
        """Draw a movement that follows the last one, of a share of its length."""
        hand, random, last = self._of.hand, self._rng, self._drawn[-1]
        size, pace, turn, arc = random.standard_normal(4)
        is_corner, rests = random.random(2) < (hand.corner_frac, hand.rest_frac)
        corner_rad = math.radians(random.uniform(hand.corner_least_deg, 360.0 - hand.corner_least_deg))
        overlap_frac, rest_s = random.uniform(0.0, hand.overlap_frac), random.exponential(hand.rest_s)
        length_mm = share * hand.length_mm * math.exp(hand.length_spread * size)
        longer = hand.isochrony * hand.length_spread * size + hand.duration_spread * pace
        duration_s = hand.duration_s * math.exp(longer)
        arc_rad = math.radians(hand.arc_deg) * arc
        t_end_s = float(last.t_begin_s[0] + last.duration_s[0])
        if is_corner:
            turn_rad, t_begin_s = corner_rad, t_end_s + rests * rest_s
        else:
            turn_rad = math.radians(hand.turn_deg) * turn
            t_begin_s = t_end_s - overlap_frac * min(float(last.duration_s[0]), duration_s)
        from_rad = float(last.from_rad[0] + last.arc_rad[0]) + turn_rad
        return _one(t_begin_s, duration_s, length_mm, from_rad, arc_rad, hand.flat_frac)

    def _room_mm(self, movement: _Movement) -> float:
        """Return how far a movement stays inside the bounds and the gap; below 0 beyond them."""
        of, last = self._of, self._drawn[-1]
        t_s = np.arange(movement.t_begin_s[0], movement.t_begin_s[0] + movement.duration_s[0] + _BEYOND_S, _STEP_S)
        path_mm = self._starts_mm[-1] + last.displacement_mm(t_s) + movement.displacement_mm(t_s)
        inside_mm = of.half_size_mm - _MARGIN_MM - math.sqrt(2) * TREMOR_MM - float(np.abs(path_mm).max())
        if of.avoid is None or inside_mm < 0.0:
            return inside_mm if of.avoid is None else inside_mm - _FARTHEST_MM
        return min(inside_mm, float(np.hypot(*(of.avoid.position_mm(t_s) - path_mm).T).min()) - GAP_MM)
