"""A user's fingers on the simulated plate: received positions become paths, like those of a scenario.

A pointing device reports some 60 times a second, the pad scans 89 times and the control loop runs 2000 times. So a
finger moves to a received position at constant speed within `GLIDE_S` instead of jumping. Not modelled: the dynamics
and pressure of a fingertip.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta

from hapticd_contract.base import Contract, Name, Place, problem_of_name

from ...values import FloatArray
from ...wire.client import read, unpack
from .paths import Path

MAX_HANDS = 5  # one hand
GLIDE_S = 0.03  # two reports of a typical pointing device
TIMEOUT_S = 0.5  # without a message for so long, all fingers lift
KEPT_S = 0.25  # of past positions, for a sensor that samples a little later

PointMm = tuple[float, float]


class HeldFinger:
    """One finger moved by a user: a growing polyline, NaN while lifted."""

    def __init__(self) -> None:
        self.t_up_s = -math.inf  # when it was lifted; inf while it is down
        self._knots: deque[tuple[float, float, float]] = deque()

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2) at recent times (T,); NaN where the finger is lifted."""
        t_s = np.asarray(t_s, dtype=np.float64)
        if not self._knots or self.t_up_s <= t_s[0]:
            return np.full((len(t_s), 2), np.nan)
        knots = np.array(self._knots)
        position = np.stack([np.interp(t_s, knots[:, 0], knots[:, axis]) for axis in (1, 2)], axis=1)
        position[(t_s < knots[0, 0]) | (t_s >= self.t_up_s)] = np.nan
        return position

    def land(self, t_s: float, point_mm: PointMm) -> None:
        """Land at `t_s`; the finger must be lifted."""
        self.t_up_s = math.inf
        self._knots = deque([(t_s, *point_mm)])

    def move(self, t_s: float, point_mm: PointMm) -> None:
        """Start moving to a point at `t_s`, which must not precede that of the last call."""
        x_mm, y_mm = self.position_mm(np.array([t_s]))[0].tolist()
        while self._knots and self._knots[-1][0] >= t_s:
            self._knots.pop()
        self._knots += ((t_s, x_mm, y_mm), (t_s + GLIDE_S, *point_mm))
        while len(self._knots) > 2 and self._knots[1][0] < t_s - KEPT_S:
            if len(self._knots) > 3 or self._knots[0][0] < t_s - KEPT_S:
                self._knots.popleft()

    def lift(self, t_s: float) -> None:
        """Lift at `t_s`."""
        self.t_up_s = t_s


class Hands:
    """All fingers of a user: `MAX_HANDS` paths, lifted until used.

    `t_taken_s` is the time of the first message, from which on the scenario's own fingers are lifted; `lifted_s` is the
    newest interval in which they lift on request.
    """

    def __init__(self) -> None:
        self.fingers: tuple[HeldFinger, ...] = tuple(HeldFinger() for _ in range(MAX_HANDS))
        self.t_taken_s = math.inf
        self.lifted_s = (math.inf, -math.inf)
        self._held: dict[str, HeldFinger] = {}
        self._t_message_s = -math.inf

    def hold(self, points_mm: Mapping[str, PointMm], t_s: float) -> None:
        """Set the fingers that are down from `t_s` on, by names of the sender's choice; all others lift."""
        self.t_taken_s = min(self.t_taken_s, t_s)
        self._t_message_s = t_s
        for name in [name for name in self._held if name not in points_mm]:
            self._held.pop(name).lift(t_s)
        for name, point_mm in points_mm.items():
            if name in self._held:
                self._held[name].move(t_s, point_mm)
            else:
                self._take(name).land(t_s, point_mm)

    def lift_scripted(self, t_s: float) -> None:
        """Lift the scenario's own fingers from `t_s` on, until TIMEOUT_S after the last request."""
        start_s, end_s = self.lifted_s
        self.lifted_s = (start_s if t_s <= end_s else t_s, t_s + TIMEOUT_S)

    def expire(self, t_s: float) -> None:
        """Lift all fingers after TIMEOUT_S without a message."""
        if self._held and t_s - self._t_message_s > TIMEOUT_S:
            self.hold({}, t_s)

    def _take(self, name: str) -> HeldFinger:
        """Assign the finger lifted for longest, so that the pad has sampled its lift."""
        free = [finger for finger in self.fingers if finger.t_up_s < math.inf]
        self._held[name] = min(free, key=lambda finger: finger.t_up_s)
        return self._held[name]


@dataclass(frozen=True)
class YieldingPath:
    """A scenario's path that is lifted on request, and for good once a user takes over."""

    path: Path
    hands: Hands

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        position, t_s = self.path.position_mm(t_s), np.asarray(t_s)
        start_s, end_s = self.hands.lifted_s
        if min(self.hands.t_taken_s, start_s) < math.inf:
            is_lifted = (t_s >= self.hands.t_taken_s) | ((t_s >= start_s) & (t_s < end_s))
            position = np.where(is_lifted[:, np.newaxis], np.nan, position)
        return position


class _Held(Contract, frozen=True):
    """The fingers that are down, by name; nil: the scenario's fingers are to lift."""

    fingers: Annotated[dict[Name, Place], Meta(max_length=MAX_HANDS)] | None

    def problem(self) -> str:
        return next(filter(None, [problem_of_name(name, ".fingers") for name in self.fingers or ()]), "")


def decode_hands(payload: bytes) -> dict[str, PointMm] | None:
    """Decode the fingers that are down, by name, or None: the scenario's fingers are to lift. Raises RequestError."""
    held: _Held = read(unpack(payload), _Held)
    return held.fingers
