"""Events of the plate: what happened, in order, for clients and recordings."""

from __future__ import annotations

from collections import deque
from typing import Final

from hapticd_contract.states import EventKind, PlateEvent

from .targets.shares import UserOf, host_of, left

MAX_AT_ONCE: Final = 256  # in one state: further ones wait for the next. 32 effects begin and 32 end in a pass
MAX_CROSSINGS: Final = 64  # waiting: those beyond are lost, which the sequence number shows
MAX_WAITING: Final = 2048  # all fingers' pressure on all effects, and more: a bound that nothing reaches
LOSSY: Final = (EventKind.ENTERED, EventKind.LEFT, EventKind.CROSSED)  # of which layers may cause any number


class Events:
    """Events since they were last taken. Their numbers count all, also the lost ones.

    Only crossings may be lost, beyond MAX_CROSSINGS and a user's share of it: all else is bounded by fingers and
    effects.
    """

    def __init__(self, user_of: UserOf = host_of) -> None:
        self.count = 0
        self.lost = 0
        self._user_of: Final = user_of
        self._waiting: deque[PlateEvent] = deque()
        self._crossings: dict[str, int] = {}  # waiting, by the layer's user

    def add(
        self,
        kind: EventKind,
        t_ns: int,
        t_device_ns: int | None = None,
        finger_id: int | None = None,
        place_mm: tuple[float, float] | None = None,
        client: str = "",
        surface: str = "",
        effect: str = "",
    ) -> None:
        """Add one; `t_ns` is when its cause occurred, on the host's axis."""
        self.count += 1
        if kind in LOSSY:
            user = self._user_of(client)
            own = self._crossings.get(user, 0)
            if left(MAX_CROSSINGS, user, sum(self._crossings.values()), own) < 1.0:
                self.lost += 1
                return
            self._crossings[user] = own + 1
        elif len(self._waiting) >= MAX_WAITING:
            self.lost += 1
            return
        x_mm, y_mm = (None, None) if place_mm is None else place_mm
        event = PlateEvent(self.count, kind, t_ns, t_device_ns, finger_id, x_mm, y_mm, client, surface, effect)
        self._waiting.append(event)

    def take(self) -> tuple[PlateEvent, ...]:
        """Return the events since the last call, up to MAX_AT_ONCE."""
        if not self._waiting:
            return ()
        taken = tuple([self._waiting.popleft() for _ in range(min(len(self._waiting), MAX_AT_ONCE))])
        for event in taken:
            if event.kind in LOSSY:
                self._crossings[self._user_of(event.client)] -= 1
        if not self._waiting:
            self._crossings.clear()
        return taken
