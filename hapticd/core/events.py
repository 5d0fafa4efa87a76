"""Events of the plate: what happened, in order, for clients and recordings."""

from __future__ import annotations

from typing import Final

from ..values import EventKind, PlateEvent

MAX_WAITING: Final = 64  # between two passes; those beyond are lost, which the sequence number shows


class Events:
    """Events since they were last taken. Their numbers count all, also the lost ones."""

    def __init__(self) -> None:
        self.count = 0
        self.lost = 0
        self._waiting: list[PlateEvent] = []

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
        if len(self._waiting) >= MAX_WAITING:
            self.lost += 1
            return
        event = PlateEvent(self.count, kind, t_ns, t_device_ns, finger_id, place_mm, client, surface, effect)
        self._waiting.append(event)

    def take(self) -> tuple[PlateEvent, ...]:
        """Return the events since the last call."""
        if not self._waiting:
            return ()
        taken = tuple(self._waiting)
        self._waiting.clear()
        return taken
