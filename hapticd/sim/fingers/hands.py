"""A user's fingers on the simulated plate: received positions become paths, like those of a scenario.

A pointing device reports some 60 times a second, the pad scans 89 times and the control loop runs 2000 times. So a
finger moves to a received position at constant speed within `GLIDE_S` instead of jumping, and its pressure and contact
with it. Not modelled: the dynamics of a fingertip.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hapticd_contract.simulated import MAX_TOUCHES, SimulatedTouch, SimulatedTouches

from ...values import FloatArray
from ...wire.client import read, unpack
from .paths import Path
from .pressing import SampledFinger, TipSample, sample_of

GLIDE_S = 0.03  # two reports of a typical pointing device
TIMEOUT_S = 0.5  # without a message for so long, all fingers lift
RETURN_S = 3.0  # after a user's last finger the scenario's land again: longer than a hand takes to touch elsewhere
KEPT_S = 0.25  # of past positions, for a sensor that samples a little later


class HeldFinger:
    """One finger moved by a user, and its tip: a growing polyline, NaN while lifted."""

    def __init__(self) -> None:
        self.t_up_s = -math.inf  # when it was lifted; inf while it is down
        self._knots: deque[tuple[float, *TipSample]] = deque()

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2) at recent times (T,); NaN where the finger is lifted."""
        t_s = np.asarray(t_s, dtype=np.float64)
        if not self._knots or self.t_up_s <= t_s[0]:
            return np.full((len(t_s), 2), np.nan)
        position = self._sampled.position_mm(np.minimum(t_s, self._knots[-1][0]))
        position[t_s >= self.t_up_s] = np.nan
        return position

    def pressure_frac(self, t_s: FloatArray) -> FloatArray:
        """Return the pressure (T,), also where the finger is lifted, where it means nothing."""
        return self._sampled.pressure_frac(t_s) if self._knots else np.full(len(t_s), np.nan)

    def ellipses_mm(self, t_s: FloatArray) -> FloatArray:
        """Return the symmetric matrices (T, 2, 2) that make the contact of the unit disc, as `pressure_frac`."""
        return self._sampled.ellipses_mm(t_s) if self._knots else np.full((len(t_s), 2, 2), np.nan)

    def land(self, t_s: float, touch: SimulatedTouch) -> None:
        """Land at `t_s`; the finger must be lifted."""
        self.t_up_s = math.inf
        self._knots = deque([(t_s, *sample_of(touch))])

    def move(self, t_s: float, touch: SimulatedTouch) -> None:
        """Start moving to a place at `t_s`, which must not precede that of the last call."""
        knots = np.array(self._knots)
        now: TipSample = tuple(float(np.interp(t_s, knots[:, 0], column)) for column in knots.T[1:])  # type: ignore[assignment]
        while self._knots and self._knots[-1][0] >= t_s:
            self._knots.pop()
        self._knots += ((t_s, *now), (t_s + GLIDE_S, *sample_of(touch)))
        while len(self._knots) > 2 and self._knots[1][0] < t_s - KEPT_S:
            if len(self._knots) > 3 or self._knots[0][0] < t_s - KEPT_S:
                self._knots.popleft()

    def lift(self, t_s: float) -> None:
        """Lift at `t_s`."""
        self.t_up_s = t_s

    @property
    def _sampled(self) -> SampledFinger:
        knots = np.array(self._knots)
        return SampledFinger(knots[:, 0], knots[:, 1:])


class Hands:
    """All fingers of users: `MAX_TOUCHES` paths, lifted until used.

    `lifted_s` is the newest interval in which the scenario's own fingers are lifted, on request or for a user's.
    """

    def __init__(self) -> None:
        self.fingers: tuple[HeldFinger, ...] = tuple(HeldFinger() for _ in range(MAX_TOUCHES))
        self.lifted_s = (math.inf, -math.inf)
        self._held: dict[tuple[str, str], HeldFinger] = {}  # by sender and name
        self._t_message_s: dict[str, float] = {}  # of senders that hold some

    def hold(self, touches: Mapping[str, SimulatedTouch], t_s: float, sender: str = "") -> None:
        """Set the fingers of one sender that are down from `t_s` on, by names of its choice; its others lift.

        A finger for which the hand has no room is not there.
        """
        if touches:
            self.lift_scripted(t_s, RETURN_S)
        for key in [key for key in self._held if key[0] == sender and key[1] not in touches]:
            self._held.pop(key).lift(t_s)
        self._t_message_s.pop(sender, None)
        for name, touch in touches.items():
            if (sender, name) in self._held:
                self._held[sender, name].move(t_s, touch)
            elif len(self._held) < MAX_TOUCHES:
                self._take(sender, name).land(t_s, touch)
            else:
                continue
            self._t_message_s[sender] = t_s

    def lift_scripted(self, t_s: float, seconds: float = TIMEOUT_S) -> None:
        """Lift the scenario's own fingers from `t_s` on, until so long after the last request."""
        start_s, end_s = self.lifted_s
        self.lifted_s = (start_s if t_s <= end_s else t_s, max(end_s, t_s + seconds))

    def expire(self, t_s: float) -> None:
        """Lift the fingers of each sender after TIMEOUT_S without its message."""
        for sender, t_message_s in tuple(self._t_message_s.items()):
            if t_s - t_message_s > TIMEOUT_S:
                self.hold({}, t_s, sender)

    def _take(self, sender: str, name: str) -> HeldFinger:
        """Assign the finger lifted for longest, so that the pad has sampled its lift."""
        free = [finger for finger in self.fingers if finger.t_up_s < math.inf]
        self._held[sender, name] = taken = min(free, key=lambda finger: finger.t_up_s)
        return taken


@dataclass(frozen=True)
class YieldingPath:
    """A scenario's path that is lifted on request, and while a user has fingers down."""

    path: Path
    hands: Hands

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        position, t_s = self.path.position_mm(t_s), np.asarray(t_s)
        start_s, end_s = self.hands.lifted_s
        return np.where(((t_s >= start_s) & (t_s < end_s))[:, np.newaxis], np.nan, position)


def decode_hands(payload: bytes) -> SimulatedTouches:
    """Decode the fingers that are down. Raises RequestError."""
    touches: SimulatedTouches = read(unpack(payload), SimulatedTouches)
    return touches
