"""Values of a state for a fixed number of fingers: each has a slot, because ids count up for ever. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hapticd_client import FingerState, PlateState

FINGER_FIELDS = tuple(  # all numbers of a finger
    name for name in FingerState.__struct_fields__ if name not in ("id", "virtual", "owner")
)
MODE_FIELDS = ("d_um", "q_um", "measured_d_um", "measured_q_um")


class Slots:
    """`count` slots; a finger keeps its slot until it lifts, and a new one takes the first free slot."""

    def __init__(self, count: int) -> None:
        self._taken: list[int | None] = [None] * count

    def assign(self, finger_ids: Sequence[int]) -> tuple[int | None, ...]:
        """Return the id in each slot, None for a free one. Fingers without a slot wait until one is free."""
        taken = [held if held in finger_ids else None for held in self._taken]
        waiting = [one for one in finger_ids if one not in taken]
        for place, held in enumerate(taken):
            if held is None and waiting:
                taken[place] = waiting.pop(0)
        self._taken = taken
        return tuple(taken)

    def clear(self) -> None:
        """Free all slots: another daemon counts its fingers from 1."""
        self._taken = [None] * len(self._taken)


class Sampler:
    """Assigns the fingers of states to slots."""

    def __init__(self, fingers: int) -> None:
        self._slots = Slots(fingers)
        self._instance: int | None = None

    def fingers(self, state: PlateState) -> tuple[FingerState | None, ...]:
        """Return the finger in each slot. Takes each state once, in order."""
        if state.instance != self._instance:
            self._instance = state.instance
            self._slots.clear()
        down = {int(finger.id): finger for finger in state.fingers if not finger.virtual}
        return tuple(None if held is None else down[held] for held in self._slots.assign(tuple(down)))


def finger_values(finger: FingerState | None) -> tuple[float | None, ...]:
    """Return the values of FINGER_FIELDS; all None without a finger."""
    return tuple(None if finger is None else _finite(getattr(finger, name)) for name in FINGER_FIELDS)


def mode_values(state: PlateState, mode: int) -> tuple[float | None, ...]:
    """Return the values of MODE_FIELDS of one mode; measured ones are None before the board measures."""
    measured_um = state.measured_um[mode] if mode < len(state.measured_um) else None
    return (
        _finite(state.modal_um[mode]),
        _finite(state.modal_q_um[mode]) if mode < len(state.modal_q_um) else None,
        None if measured_um is None else _finite(measured_um.real),
        None if measured_um is None else _finite(measured_um.imag),
    )


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
