"""The firmware's signal chain by itself: `firmware/core/carrier.c` without a plate, samples to amplitudes and back."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hapticd.sim.board.firmware import load

CHUNK: Final = 50
MID_RAIL: Final = 0x800

Samples = npt.NDArray[np.uint16]
Phasors = npt.NDArray[np.complex64]


class _Oscillation(ctypes.Structure):
    """`hd_oscillation_t` of firmware/core/carrier.h."""

    _fields_ = [("phase", ctypes.c_uint32), ("step", ctypes.c_uint32)]


@cache
def _carrier_type(modes: int) -> type[ctypes.Structure]:
    """The first members of `hd_carrier_t` of firmware/core/carrier.h, and space for the rest."""

    class Carrier(ctypes.Structure):
        _fields_ = [
            ("drive_hz", ctypes.c_float),
            ("control_hz", ctypes.c_float),
            ("volts_per_lsb", ctypes.c_float * modes),
            ("um_per_lsb", ctypes.c_float * modes),
            ("spoken", _Oscillation),
            ("played", _Oscillation * 2),
            ("rest", ctypes.c_uint8 * 512),
        ]

    return Carrier


class SignalChain:
    """The firmware's oscillator, synthesis and demodulation for M modes, called as a board's interrupt calls them.

    Amplitudes are in converter steps. `phase` is that of the first input sample, in 1/2^32 of a turn. Raises ValueError
    if the firmware refuses the rates.
    """

    def __init__(self, drive_hz: float, control_hz: float = 2000.0, *, modes: int = 2, phase: int = 0) -> None:
        self.modes = modes
        self._library = load(modes)
        ones = (1.0,) * modes
        self._carrier: Any = _carrier_type(modes)()
        converters = _carrier_type(modes)(drive_hz, control_hz, ones, ones)
        if not self._library.hd_carrier_init(ctypes.byref(self._carrier), ctypes.byref(converters)):
            raise ValueError(f"The firmware refuses a drive of {drive_hz:g} Hz with control at {control_hz:g} Hz.")
        for oscillation in (self._carrier.spoken, *self._carrier.played):
            oscillation.phase += phase

    @property
    def step(self) -> int:
        """Phase increment per sample of the next chunk, in 1/2^32 of a turn."""
        return int(self._carrier.spoken.step)

    @property
    def phase(self) -> int:
        """Phase of the next output sample."""
        return int(self._carrier.spoken.phase)

    def drive(self, level_lsb: npt.ArrayLike) -> None:
        """Set the amplitudes (M,) complex for the next chunks."""
        levels = np.ascontiguousarray(level_lsb, dtype=np.complex64)
        assert levels.shape == (self.modes,)
        self._library.hd_carrier_drive(ctypes.byref(self._carrier), ctypes.c_void_p(levels.ctypes.data))

    def synthesise(self) -> Samples:
        """Return the next output chunk (50, M) of 12-bit samples, right-aligned in 16."""
        samples = np.empty((CHUNK, self.modes), dtype=np.uint16)
        self._library.hd_carrier_speak(ctypes.byref(self._carrier), ctypes.c_void_p(samples.ctypes.data))
        return samples

    def demodulate(self, samples: Samples) -> Phasors | None:
        """Process an input chunk (50, M); returns the amplitudes (M,) if it completes a control tick."""
        chunk = np.ascontiguousarray(samples, dtype=np.uint16)
        assert chunk.shape == (CHUNK, self.modes)
        if not self._library.hd_carrier_listen(ctypes.byref(self._carrier), ctypes.c_void_p(chunk.ctypes.data)):
            return None
        measured = np.empty(self.modes, dtype=np.complex64)
        self._library.hd_carrier_measure(ctypes.byref(self._carrier), ctypes.c_void_p(measured.ctypes.data))
        return measured

    def measure(self, samples: Samples) -> Phasors:
        """Return the amplitudes (T, M) of all whole ticks in samples (N, M)."""
        amplitudes = []
        for start in range(0, len(samples) - CHUNK + 1, CHUNK):
            measured = self.demodulate(samples[start : start + CHUNK])
            amplitudes += [] if measured is None else [measured]
            self.synthesise()
        return np.array(amplitudes, dtype=np.complex64).reshape(-1, self.modes)
