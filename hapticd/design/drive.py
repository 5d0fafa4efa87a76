"""Drive frequency for all modes of one oscillator: it minimises the amplifiers' largest voltage for full amplitude.

The voltage of one mode, W |sigma - j 2 pi (f_mode - f)| / g, is convex in f. An amplifier that drives several modes
needs at most the sum of its shares of them, all at full amplitude and in the worst phases; sums and maxima of convex
functions are convex, so there is one minimum, between the lowest and the highest resonance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..board_values import ModeCalibration

_SHRINK = (math.sqrt(5.0) - 1.0) / 2.0  # golden section
_CLOSE_HZ = 1e-4


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
