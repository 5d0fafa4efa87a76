"""A person's fingers on the simulated plate: positions that somebody sends become paths, as a scenario's are.

A pointing device tells where it is some 60 times a second, the pad scans 89 times and the plate moves 2000 times. So a
finger does not jump to where it was told: it is there `GLIDE_S` later, at a constant speed, and a hand that moves
evenly makes a finger that does. What it leaves out: a fingertip's own dynamics, and its pressure.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...errors import RequestError
from ...wire.fields import Fields, bounded, items, label, unpack
from .paths import Path

MAX_HANDS = 5  # those of one hand
GLIDE_S = 0.03  # two reports of a usual pointing device
SILENT_S = 0.5  # a sender that says nothing for so long has let go
MAX_POSITION_MM = 1000.0
KEPT_S = 0.25  # of the past, for a sensor that asks a little late

Array = npt.NDArray[np.float64]
Point = tuple[float, float]


class Held:
    """One finger that a person moves: a polyline that grows, NaN while it is lifted."""

    def __init__(self) -> None:
        self.t_up_s = -math.inf  # since when it is lifted; inf while it is down
        self._knots: deque[tuple[float, float, float]] = deque()

    def position_mm(self, t_s: Array) -> Array:
        """Positions (T, 2) at times (T,) that are not long past; NaN where the finger is not on the plate."""
        t_s = np.asarray(t_s, dtype=np.float64)
        if not self._knots or self.t_up_s <= t_s[0]:
            return np.full((len(t_s), 2), np.nan)
        knots = np.array(self._knots)
        position = np.stack([np.interp(t_s, knots[:, 0], knots[:, axis]) for axis in (1, 2)], axis=1)
        position[(t_s < knots[0, 0]) | (t_s >= self.t_up_s)] = np.nan
        return position

    def land(self, t_s: float, point_mm: Point) -> None:
        """Touch at `t_s`, where it was lifted before."""
        self.t_up_s = math.inf
        self._knots = deque([(t_s, *point_mm)])

    def move(self, t_s: float, point_mm: Point) -> None:
        """Set out at `t_s`, which does not lie before the last call's, for a point."""
        x_mm, y_mm = self.position_mm(np.array([t_s]))[0].tolist()
        while self._knots and self._knots[-1][0] >= t_s:
            self._knots.pop()
        self._knots += ((t_s, x_mm, y_mm), (t_s + GLIDE_S, *point_mm))
        while len(self._knots) > 2 and self._knots[1][0] < t_s - KEPT_S:
            if len(self._knots) > 3 or self._knots[0][0] < t_s - KEPT_S:
                self._knots.popleft()

    def lift(self, t_s: float) -> None:
        """Leave the plate at `t_s`."""
        self.t_up_s = t_s


class Hands:
    """All fingers of a person: `MAX_HANDS` paths, which lie in the air until somebody takes them.

    `t_taken_s` is when the first message came: from then on a scenario's own fingers are in the air.
    """

    def __init__(self) -> None:
        self.fingers: tuple[Held, ...] = tuple(Held() for _ in range(MAX_HANDS))
        self.t_taken_s = math.inf
        self._held: dict[str, Held] = {}
        self._t_heard_s = -math.inf

    def hold(self, points_mm: Mapping[str, Point], t_s: float) -> None:
        """These fingers, by names of the sender's choice, are down from `t_s` on, and no others."""
        self.t_taken_s = min(self.t_taken_s, t_s)
        self._t_heard_s = t_s
        for name in [name for name in self._held if name not in points_mm]:
            self._held.pop(name).lift(t_s)
        for name, point_mm in points_mm.items():
            if name in self._held:
                self._held[name].move(t_s, point_mm)
            else:
                self._take(name).land(t_s, point_mm)

    def expire(self, t_s: float) -> None:
        """Let go of all where the sender has been silent for too long."""
        if self._held and t_s - self._t_heard_s > SILENT_S:
            self.hold({}, t_s)

    def _take(self, name: str) -> Held:
        """The finger that has been in the air for longest: the pad has seen it lifted."""
        free = [finger for finger in self.fingers if finger.t_up_s < math.inf]
        self._held[name] = min(free, key=lambda finger: finger.t_up_s)
        return self._held[name]


@dataclass(frozen=True)
class Yielding:
    """A scenario's finger that leaves the plate for good once a person takes over."""

    path: Path
    hands: Hands

    def position_mm(self, t_s: Array) -> Array:
        position = self.path.position_mm(t_s)
        if self.hands.t_taken_s < math.inf:
            position = np.where((np.asarray(t_s) < self.hands.t_taken_s)[:, np.newaxis], position, np.nan)
        return position


def decode_hands(payload: bytes) -> dict[str, Point]:
    """The fingers that a person holds now, by name. Raises RequestError."""
    fields = Fields(unpack(payload))
    fingers = fields.take("fingers")
    fields.end()
    if not isinstance(fingers, dict) or len(fingers) > MAX_HANDS:
        raise RequestError(f"fingers: must be a map of at most {MAX_HANDS} fingers to [x_mm, y_mm].")
    return {label(name, "fingers"): _point(point, f"fingers.{name}"[:48]) for name, point in fingers.items()}


def _point(value: object, where: str) -> Point:
    numbers: Sequence[object] = items(value, 2, where)
    if len(numbers) != 2:
        raise RequestError(f"{where}: a point has two numbers, x and y.")
    x_mm, y_mm = (bounded(number, -MAX_POSITION_MM, MAX_POSITION_MM, where) for number in numbers)
    return x_mm, y_mm
