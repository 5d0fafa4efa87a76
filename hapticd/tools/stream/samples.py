"""A state of the plate as one row of numbers: always the same columns, whoever touches. Pure.

timestamp, t_s, seq, state, ...        of the whole plate
mode_0_d_um, mode_0_q_um, ...          of each mode, as many as the plate has
finger_1_id, finger_1_x_mm, ...        of each slot, empty (None) while no finger holds it
virtual/NAME/x_mm, ...                 of each virtual finger, while there is one
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from hapticd_client import FingerState, PlateState

from .slots import Slots

Value = float | int | bool | None

STATES = ("IDLE", "ARMED", "ACTIVE", "FAULT", "STOPPED")  # in `state`, by their place here
FINGER_FIELDS = ("x_mm", "y_mm", "predicted_x_mm", "predicted_y_mm", "target_um", "achieved_um")
MODE_FIELDS = ("d_um", "q_um", "measured_d_um", "measured_q_um")


class Sampler:
    """Turns states into rows; keeps who is in which slot, and counts markers."""

    def __init__(self, fingers: int) -> None:
        self._slots = Slots(fingers)
        self._instance: int | None = None
        self._markers = 0

    def row(self, state: PlateState, unix_offset_ns: int) -> dict[str, Value]:
        """One row. `unix_offset_ns` is what the wall clock shows beyond the monotonic one."""
        self._count(state)
        row: dict[str, Value] = {
            "timestamp": (state.t_ns + unix_offset_ns) / 1e9,
            "t_s": state.t_ns / 1e9,
            "seq": state.seq,
            "state": STATES.index(state.state) if state.state in STATES else None,
            "limited": state.limited,
            "condition": _finite(state.condition),
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
        """The finger in each slot; call it once for each state, in order, or let `row` do it."""
        if state.instance != self._instance:
            self._instance = state.instance
            self._slots.clear()
        down = {int(finger.id): finger for finger in state.fingers if not finger.virtual}
        return tuple(None if held is None else down[held] for held in self._slots.assign(tuple(down)))

    def _count(self, state: PlateState) -> None:
        self._markers += len(state.markers)


def finger_values(finger: FingerState | None) -> tuple[float | None, ...]:
    """What FINGER_FIELDS name; all None for no finger."""
    return tuple(None if finger is None else _finite(getattr(finger, name)) for name in FINGER_FIELDS)


def mode_values(state: PlateState, mode: int) -> tuple[float | None, ...]:
    """What MODE_FIELDS name of one mode: what is asked of it, and what the board last measured, None before it did."""
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
