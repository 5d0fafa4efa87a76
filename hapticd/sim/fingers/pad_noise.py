"""Noise of a trackpad's positions: white, or as the firmware of real pads leaves it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

import msgspec
import numpy as np

from ...values import FloatArray

_Size = Annotated[float, msgspec.Meta(ge=0.0)]  # of a world in a file


@dataclass(frozen=True, slots=True)
class PadNoise:
    """`noise_mm` is the standard deviation on each axis, `noise_correlation` that of one report's with the next one's:
    0 is white, firmware that averages gives more. `time_error_ms` is the RMS of a heavy-tailed error along the way
    (Student's t of three degrees of freedom), as if the position were taken at another instant. A position that has
    moved by less than `hold_mm` is reported as before.
    """

    noise_mm: _Size
    noise_correlation: Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)] = 0.0
    time_error_ms: _Size = 0.0
    hold_mm: _Size = 0.0


# As measured on pads whose firmware filters: across the way typically 0.02 .. 0.03 mm, along it 0.5 .. 0.8 ms, and a
# finger at rest repeats its report. At 10 cm/s its RMS is 0.074 mm, that of white noise of 0.05 mm 0.071.
FILTERED_NOISE: Final = PadNoise(0.025, noise_correlation=0.65, time_error_ms=0.65, hold_mm=0.06)


class Firmware:
    """Positions of one finger as a pad's firmware reports them, over the blocks of its scans."""

    def __init__(self, noise: PadNoise) -> None:
        self._of = noise
        self._noise: FloatArray | None = None
        self._held_mm: FloatArray | None = None

    def sensed_s(self, t_s: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the instants (n,) whose positions are reported for scans at `t_s`."""
        if self._of.time_error_ms == 0.0:
            return t_s
        deviation_s = 1e-3 * self._of.time_error_ms / math.sqrt(3.0)  # of Student's t: its variance is 3
        return np.asarray(t_s + deviation_s * rng.standard_t(3, len(t_s)))

    def correlated(self, white: FloatArray) -> FloatArray:
        """Return noise (n, 2) of the same deviation as `white`, each correlated with the one before."""
        correlation = self._of.noise_correlation
        if correlation == 0.0:
            return white
        noise = white.copy()
        for row, fresh in zip(noise, white, strict=True):
            if self._noise is not None:
                row[:] = correlation * self._noise + math.sqrt(1.0 - correlation**2) * fresh
            self._noise = row
        return noise

    def held_mm(self, xy_mm: FloatArray) -> FloatArray:
        """Return positions (n, 2), each as before until it has moved by `hold_mm`."""
        if self._of.hold_mm == 0.0:
            return xy_mm
        held_mm = xy_mm.copy()
        for row in held_mm:
            if self._held_mm is not None and math.dist(row, self._held_mm) < self._of.hold_mm:
                row[:] = self._held_mm
            self._held_mm = row
        return held_mm
