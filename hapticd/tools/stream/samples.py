"""Values of a state for a fixed number of fingers: each has a slot, because ids count up for ever. Pure."""

from __future__ import annotations

import math

from hapticd_client import FingerState, PlateState

FINGER_FIELDS = tuple(  # all numbers of a finger
    name for name in FingerState.__struct_fields__ if name not in ("id", "virtual", "owner")
)
MODE_FIELDS = ("d_um", "q_um", "measured_d_um", "measured_q_um")


class Slots:
    """`count` slots; a finger keeps its slot until it lifts, and a new one takes the first free slot. Another daemon
    counts its fingers from 1: then all are free."""

    def __init__(self, count: int) -> None:
        self._taken: list[int | None] = [None] * count
        self._instance: int | None = None

    def fingers(self, state: PlateState) -> tuple[FingerState | None, ...]:
        """Return the finger in each slot; those without one wait until one is free. Takes each state once, in order."""
        down = {int(finger.id): finger for finger in state.fingers if not finger.virtual}
        is_same = state.instance == self._instance
        self._instance = state.instance
        held = [one if is_same and one in down else None for one in self._taken]
        waiting = iter([one for one in down if one not in held])
        self._taken = [next(waiting, None) if one is None else one for one in held]
        return tuple(None if one is None else down[one] for one in self._taken)


def finger_values(finger: FingerState | None) -> list[float]:
    """Return the id and the values of FINGER_FIELDS; NaN where there is none."""
    return [_number(None if finger is None else getattr(finger, name)) for name in ("id", *FINGER_FIELDS)]


def mode_values(state: PlateState, mode: int) -> list[float]:
    """Return the values of MODE_FIELDS of one mode; measured ones are NaN before the board measures."""
    measured_um = state.measured_um[mode] if mode < len(state.measured_um) else complex(math.nan, math.nan)
    q_um = state.modal_q_um[mode] if mode < len(state.modal_q_um) else None
    return [_number(state.modal_um[mode]), _number(q_um), measured_um.real, measured_um.imag]


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
