"""The carrier of the board: its converters, and the firmware's signal chain by itself.

With `Converters`, `board.Board` simulates the carrier: 1 MHz samples through `firmware/core/carrier.c` and a plate of
real resonators, instead of envelopes. `SignalChain` is the same C without a plate: samples to amplitudes and back.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from .firmware import ConverterSetup, load

SAMPLE_HZ: Final = 1_000_000
CHUNK: Final = 50
MID_RAIL: Final = 0x8000

Samples = npt.NDArray[np.uint16]
Phasors = npt.NDArray[np.complex64]


@dataclass(frozen=True, slots=True)
class Converters:
    """12-bit converters, the same for every mode; the defaults span 181 V and 8 um, as on the STM32 board.

    `offset_lsb` is the ADC's reading at rest, from mid-rail, `noise_lsb` the standard deviation of its samples, and
    `amplifier_lag_us` the time constant of the amplifiers, 0 or at least 0.1.
    """

    volts_per_lsb: float = 0.0886
    um_per_lsb: float = 0.0039
    offset_lsb: float = 0.0
    noise_lsb: float = 1.0
    amplifier_lag_us: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 < self.volts_per_lsb < math.inf and 0.0 < self.um_per_lsb < math.inf):
            raise ValueError("Converters: volts_per_lsb and um_per_lsb are positive and finite.")
        if not (math.isfinite(self.offset_lsb) and 0.0 <= self.noise_lsb < math.inf):
            raise ValueError("Converters: offset_lsb is finite, noise_lsb neither negative nor infinite.")
        if not (self.amplifier_lag_us == 0.0 or 0.1 <= self.amplifier_lag_us < math.inf):
            raise ValueError(f"Converters: amplifier_lag_us is {self.amplifier_lag_us}: give 0, or at least 0.1.")

    def loop_phase_rad(self, drive_hz: float) -> float:
        """Return the constant phase of this loop: half a sample of the DAC's hold, and the amplifier's lag."""
        lag_rad = math.atan(2.0 * math.pi * drive_hz * self.amplifier_lag_us * 1e-6)
        return -math.pi * drive_hz / SAMPLE_HZ - lag_rad

    def setup(self) -> ConverterSetup:
        return ConverterSetup(
            self.volts_per_lsb, self.um_per_lsb, self.offset_lsb, self.noise_lsb, self.amplifier_lag_us
        )


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
            raise ValueError(
                f"The firmware refuses a drive of {drive_hz:g} Hz with control at {control_hz:g} Hz: drive at 20 to "
                f"125 kHz and ticks of 1 to 40 whole chunks of {CHUNK} us."
            )
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

    def tune(self, drive_hz: float) -> None:
        self._library.hd_carrier_tune(ctypes.byref(self._carrier), ctypes.c_float(drive_hz))

    def drive(self, level_lsb: npt.ArrayLike) -> None:
        """Set the amplitudes (M,) complex for the next chunks."""
        levels = np.ascontiguousarray(level_lsb, dtype=np.complex64)
        if levels.shape != (self.modes,):
            raise ValueError(f"level_lsb has shape {levels.shape}, not {(self.modes,)}.")
        self._library.hd_carrier_drive(ctypes.byref(self._carrier), ctypes.c_void_p(levels.ctypes.data))

    def synthesise(self) -> Samples:
        """Return the next output chunk (50, M) of 12-bit samples, left-aligned in 16."""
        samples = np.empty((CHUNK, self.modes), dtype=np.uint16)
        self._library.hd_carrier_speak(ctypes.byref(self._carrier), ctypes.c_void_p(samples.ctypes.data))
        return samples

    def demodulate(self, samples: Samples) -> Phasors | None:
        """Process an input chunk (50, M); returns the amplitudes (M,) if it completes a control tick."""
        chunk = np.ascontiguousarray(samples, dtype=np.uint16)
        if chunk.shape != (CHUNK, self.modes):
            raise ValueError(f"A chunk has shape {(CHUNK, self.modes)}, not {chunk.shape}.")
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
