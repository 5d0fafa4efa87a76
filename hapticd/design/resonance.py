"""Rational least-squares fit of one mode to a frequency sweep, and the drive frequency for all modes.

In the steady state a mode driven with the voltage V at f answers W = -j g L V / (sigma - 2 pi j (f0 - f)), a circle in
the complex plane, with the unit phasor L of the loop's constant phase. Other modes far away add what is nearly constant
over the sweep. Hence W / V = a / (c + 2 pi j f) + b with complex a, b and c = sigma - 2 pi j f0, which is linear in
a + b c, b and c once multiplied out. Dividing each row by the last denominator (Sanathanan and Koerner, 1963) gives the
residuals back their weight.

The drive of all modes' one oscillator minimises the amplifiers' largest voltage for full amplitude.
The voltage of one mode, W |sigma - j 2 pi (f_mode - f)| / g, is convex in f. An amplifier that drives several modes
needs at most the sum of its shares of them, all at full amplitude and in the worst phases; sums and maxima of convex
functions are convex, so there is one minimum, between the lowest and the highest resonance.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..board_values import ModeCalibration

MIN_POINTS = 5  # three complex unknowns; fewer points would fit anything
ITERATIONS = 20
_SHRINK = (math.sqrt(5.0) - 1.0) / 2.0  # golden section
_CLOSE_HZ = 1e-4


@dataclass(frozen=True, slots=True)
class Resonance:
    """A fitted mode. `background_um_per_v` is the response of other modes; `residual_frac` the RMS of the residual over
    the largest response."""

    frequency_hz: float
    q_factor: float
    gain_um_per_v_s: float
    loop_phase_rad: float
    background_um_per_v: complex
    residual_frac: float

    def response(self, frequency_hz: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
        """Return W / V (n,) in um/V at each frequency (n,)."""
        decay_1_s = math.pi * self.frequency_hz / self.q_factor
        detuning_rad_s = 2.0 * math.pi * (self.frequency_hz - frequency_hz)
        turned = -1j * self.gain_um_per_v_s * cmath.exp(1j * self.loop_phase_rad)
        return np.asarray(turned / (decay_1_s - 1j * detuning_rad_s) + self.background_um_per_v)

    def calibration(self, mode: int) -> ModeCalibration:
        """Return the calibration of `mode` for the board."""
        return ModeCalibration(mode, self.frequency_hz, self.q_factor, self.gain_um_per_v_s, self.loop_phase_rad)


def fit_resonance(frequency_hz: npt.NDArray[np.float64], response_um_per_v: npt.NDArray[np.complex128]) -> Resonance:
    """Fit a resonance to responses (n,) at frequencies (n,).

    Raises ValueError for fewer than MIN_POINTS points, values that are not finite, or a response without a decaying
    resonance.
    """
    f_hz, y = np.asarray(frequency_hz, np.float64), np.asarray(response_um_per_v, np.complex128)
    if len(f_hz) < MIN_POINTS or f_hz.shape != y.shape or np.ptp(f_hz) == 0.0:
        raise ValueError(f"A resonance needs {MIN_POINTS} or more points at different frequencies.")
    if not (np.isfinite(f_hz).all() and np.isfinite(y).all() and np.abs(y).max() > 0.0):
        raise ValueError("The sweep holds values that are not finite, or no vibration: repeat it with more voltage.")
    centre_hz, half_hz = float(f_hz.mean()), float(np.ptp(f_hz)) / 2.0
    s = 1j * (f_hz - centre_hz) / half_hz  # of order 1, as are then all unknowns
    scale = float(np.abs(y).max())
    a, b, c = _fit_pole(s, y / scale)
    decay_1_s = 2.0 * math.pi * half_hz * c.real
    resonance_hz = centre_hz - half_hz * c.imag
    turned = 2.0 * math.pi * half_hz * scale * a
    if not (decay_1_s > 0.0 and resonance_hz > 0.0 and abs(turned) > 0.0):
        raise ValueError(
            "The response does not look like a resonance: sweep a wider band around it, or with more voltage."
        )
    return Resonance(
        frequency_hz=resonance_hz,
        q_factor=math.pi * resonance_hz / decay_1_s,
        gain_um_per_v_s=abs(turned),
        loop_phase_rad=cmath.phase(1j * turned),
        background_um_per_v=scale * b,
        residual_frac=float(np.sqrt(np.mean(np.abs(a / (c + s) + b - y / scale) ** 2))),
    )


def _fit_pole(s: npt.NDArray[np.complexfloating], y: npt.NDArray[np.complex128]) -> tuple[complex, complex, complex]:
    """Return a, b, c of y = a / (c + s) + b."""
    weight = np.ones(len(s))
    a = b = c = 0j
    for _ in range(ITERATIONS):
        rows = np.column_stack([np.ones_like(s), s, -y]) * weight[:, None]
        (a_bc, b, c), *_ = np.linalg.lstsq(rows, y * s * weight, rcond=None)
        a = a_bc - b * c
        weight = 1.0 / np.maximum(np.abs(c + s), 1e-6)
    return complex(a), complex(b), complex(c)


# --- the drive frequency ----------------------------------------------------------------------------------------


def voltage_v(mode: ModeCalibration, drive_hz: float, amplitude_um: float) -> float:
    """Return the voltage that holds a mode at `amplitude_um` when it is driven at `drive_hz`."""
    model = mode.model(drive_hz)
    return amplitude_um * math.hypot(model.decay_1_s, model.detuning_rad_s) / model.gain_um_per_v_s


def largest_voltage_v(modes: Sequence[ModeCalibration], drive_hz: float, amplitude_um: Sequence[float]) -> float:
    """Return the largest voltage of an amplifier with all modes at `amplitude_um` (M,), in their worst phases.

    A mode without measured wires has an amplifier of its own.
    """
    needed_v = [voltage_v(mode, drive_hz, um) for mode, um in zip(modes, amplitude_um, strict=True)]
    shared_v: dict[int, float] = {}
    for mode, mode_v in zip(modes, needed_v, strict=True):
        for amplifier, share in enumerate(mode.drive):
            shared_v[amplifier] = shared_v.get(amplifier, 0.0) + abs(share) * mode_v
    alone_v = [mode_v for mode, mode_v in zip(modes, needed_v, strict=True) if not mode.drive]
    return max([*alone_v, *shared_v.values()])


def propose_drive_hz(modes: Sequence[ModeCalibration], amplitude_um: Sequence[float]) -> float:
    """Return the frequency that minimises `largest_voltage_v`. Raises ValueError without modes."""
    if not modes:
        raise ValueError("a drive frequency needs one mode or more.")
    low_hz, high_hz = min(mode.frequency_hz for mode in modes), max(mode.frequency_hz for mode in modes)
    while high_hz - low_hz > _CLOSE_HZ:
        left_hz, right_hz = high_hz - _SHRINK * (high_hz - low_hz), low_hz + _SHRINK * (high_hz - low_hz)
        if largest_voltage_v(modes, left_hz, amplitude_um) < largest_voltage_v(modes, right_hz, amplitude_um):
            high_hz = right_hz
        else:
            low_hz = left_hz
    return (low_hz + high_hz) / 2.0
