"""States as a daemon publishes them."""

from __future__ import annotations

from hapticd_client import FingerState, Marker, PlateState


def finger(key: int | str, x_mm: float = 0.0, **more: float | None) -> FingerState:
    """One finger; values not given are None."""
    fields = {"predicted_x_mm": None, "predicted_y_mm": None, "target_um": None, "achieved_um": None, **more}
    return FingerState(id=key, x_mm=x_mm, y_mm=2.0, virtual=isinstance(key, str), **fields)


def plate_state(*fingers: FingerState, markers: tuple[Marker, ...] = ()) -> PlateState:
    """A state of a plate with two modes."""
    return PlateState(
        instance=7,
        seq=1,
        t_ns=5_010_000_000,
        state="ACTIVE",
        fingers=fingers,
        modal_um=(1.5, -0.5),
        limited=False,
        age_ms=10.0,
        horizon_ms=16.5,
        markers=markers,
        modal_q_um=(0.0, 0.25),
        measured_d_q_um=((1.25, 0.5), (-0.5, 0.0)),
    )
