"""A state of the plate as one row of numbers with constant columns. Pure.

timestamp, t_s, seq, state, ...        of the whole plate
mode_0_d_um, mode_0_q_um, ...          of each mode, as many as the plate has
finger_1_id, finger_1_x_mm, ...        of each slot, None while it is free
virtual/NAME/x_mm, ...                 of each virtual finger, while it exists

Fingers have slots because their ids count up for ever: curves by id would come and go.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from hapticd_client import FingerState, PlateState

Value = float | int | bool | None

STATES = ("IDLE", "ARMED", "ACTIVE", "FAULT", "STOPPED")  # `state` is the index
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
    """Converts states to rows; assigns fingers to slots, and counts markers."""

    def __init__(self, fingers: int) -> None:
        self._slots = Slots(fingers)
        self._instance: int | None = None
        self._markers = 0

    def row(self, state: PlateState, unix_offset_ns: int) -> dict[str, Value]:
        """Return one row. `unix_offset_ns` is the wall clock minus the monotonic clock."""
        self._markers += len(state.markers)
        row: dict[str, Value] = {
            "timestamp": (state.t_ns + unix_offset_ns) / 1e9,
            "t_s": state.t_ns / 1e9,
            "seq": state.seq,
            "state": STATES.index(state.state) if state.state in STATES else None,
            "limited": state.limited,
            "misses_target": state.misses_target,
            "age_ms": _finite(state.age_ms),
            "horizon_ms": _finite(state.horizon_ms),
            "fingers": sum(not finger.virtual for finger in state.fingers),
            "markers": self._markers,
        }
        for mode in range(len(state.modal_um)):
            row |= _named(f"mode_{mode}_", MODE_FIELDS, mode_values(state, mode))
        for place, finger in enumerate(self.fingers(state), 1):
            row[f"finger_{place}_id"] = None if finger is None else int(finger.id)
            row |= _named(f"finger_{place}_", FINGER_FIELDS, finger_values(finger))
        for finger in state.fingers:
            if finger.virtual:
                row |= _named(f"virtual/{finger.id}/", FINGER_FIELDS, finger_values(finger))
        return row

    def fingers(self, state: PlateState) -> tuple[FingerState | None, ...]:
        """Return the finger in each slot. Takes each state once, in order; `row` calls it."""
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


def _named(prefix: str, names: Sequence[str], values: Sequence[Value]) -> dict[str, Value]:
    return {prefix + name: value for name, value in zip(names, values, strict=True)}


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
