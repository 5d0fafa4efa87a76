"""The converters of the board's carrier.

With them `board.Board` simulates the carrier: 1 MHz samples through `firmware/core/carrier.c` and a plate of real
resonators, instead of envelopes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

SAMPLE_HZ: Final = 1_000_000


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

    def loop_phase_rad(self, drive_hz: float) -> float:
        """Return the constant phase of this loop: half a sample of the DAC's hold, and the amplifier's lag."""
        lag_rad = math.atan(2.0 * math.pi * drive_hz * self.amplifier_lag_us * 1e-6)
        return -math.pi * drive_hz / SAMPLE_HZ - lag_rad


@dataclass(frozen=True, slots=True)
class Lead:
    """What stands between a sensor and its converter; the defaults are a sound lead.

    `hum_lsb` is the amplitude of the mains, `clip_lsb` the preamplifier's range to either side of its middle, 0 for the
    converter's own, `heard_lsb_per_v` what it picks up of all amplifiers' voltages together.
    """

    offset_lsb: float = 0.0
    noise_lsb: float = 1.0
    hum_lsb: float = 0.0
    hum_hz: float = 50.0
    clip_lsb: float = 0.0
    heard_lsb_per_v: float = 0.0
