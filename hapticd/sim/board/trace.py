"""Input and output arrays of a board run, which C reads and writes in place."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .firmware import TraceBuffer


class BoardTrace:
    """Preallocated history, one row per tick: reference, measurement, true plate, voltage and flags.

    `reference_um` `measured_um` `voltage_v` (T, M) and `plate_um` (T, P) complex128, `flags` (T,) uint8. The
    measurement is the mean over the tick just ended; the voltage acts 50 us later, one chunk of the carrier.
    """

    __slots__ = ("flags", "measured_um", "plate_um", "reference_um", "voltage_v")

    def __init__(self, ticks: int, modes: int, plate_modes: int) -> None:
        self.reference_um = np.zeros((ticks, modes), dtype=np.complex128)
        self.measured_um = np.zeros((ticks, modes), dtype=np.complex128)
        self.plate_um = np.zeros((ticks, plate_modes), dtype=np.complex128)
        self.voltage_v = np.zeros((ticks, modes), dtype=np.complex128)
        self.flags = np.zeros(ticks, dtype=np.uint8)

    def __len__(self) -> int:
        return len(self.flags)

    @property
    def modes(self) -> int:
        return self.reference_um.shape[1]

    @property
    def plate_modes(self) -> int:
        return self.plate_um.shape[1]


class TickBuffers(NamedTuple):
    """The arrays of a run in many short parts, validated once, with their addresses for C."""

    phi: npt.NDArray[np.float64]
    contact_decay_1_s: npt.NDArray[np.float64]
    contact_detuning_rad_s: npt.NDArray[np.float64] | None
    out: BoardTrace
    length: int
    fingers: int
    phi_at: int
    contact_decay_at: int
    contact_detuning_at: int
    trace: Any

    @classmethod
    def of(
        cls,
        phi: npt.NDArray[np.float64],
        contact_decay_1_s: npt.NDArray[np.float64],
        contact_detuning_rad_s: npt.NDArray[np.float64] | None,
        out: BoardTrace,
        modes: int,
        plate_modes: int,
    ) -> TickBuffers:
        """Validate every size, as C does not check. Raises ValueError."""
        if (out.modes, out.plate_modes) != (modes, plate_modes):
            raise ValueError(
                f"A trace of {out.modes} modes and {out.plate_modes} plate modes does not fit a board of {modes} and "
                f"{plate_modes}."
            )
        fingers = int(phi.shape[1]) if phi.ndim == 3 else 0
        detuning = contact_decay_1_s if contact_detuning_rad_s is None else contact_detuning_rad_s
        shapes = (
            ("phi", phi, (fingers, plate_modes)),
            ("contact_decay_1_s", contact_decay_1_s, (fingers,)),
            ("contact_detuning_rad_s", detuning, (fingers,)),
        )
        for name, rows, row in shapes:
            if rows.shape[1:] != row or rows.dtype != np.float64 or not rows.flags.c_contiguous:
                raise ValueError(
                    f"{name} is {rows.dtype} of shape {rows.shape}: it must have C-contiguous float64 rows of shape "
                    f"{row}."
                )
        columns = (out.reference_um, out.measured_um, out.plate_um, out.voltage_v, out.flags)
        trace = ctypes.pointer(TraceBuffer(*(column.ctypes.data for column in columns)))
        length = min(len(phi), len(contact_decay_1_s), len(detuning), len(out))
        at = phi.ctypes.data, contact_decay_1_s.ctypes.data, detuning.ctypes.data
        return cls(phi, contact_decay_1_s, contact_detuning_rad_s, out, length, fingers, *at, trace)
