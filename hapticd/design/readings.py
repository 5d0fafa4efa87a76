"""What a vibrometer's readings need before a fit: one phase per mode out, and points that it lost found.

A mode of a lightly damped plate is a standing wave: all points move in phase or in antiphase. Its complex readings lie
on a line through zero whose angle is that of the drive, not of the plate; what lies across the line is noise, or the
sign that something else than one mode was measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .legendre import FloatArray

Readings = npt.NDArray[np.float64] | npt.NDArray[np.complex128]

_SIGMA_PER_MEDIAN = 1.4826  # of normal noise: standard deviation over median size
_FARTHEST_SIGMA = 6.0  # normal noise goes farther once in 500 million readings
_SMALLEST_FRAC = 0.05  # of the mode's RMS: a miss below is harmless, and where noise is none it is the fit's own


class InPhase(NamedTuple):
    """Real values (N, M), and per mode (M,) the phase in (-pi/2, pi/2] taken out and the RMS of what lay across."""

    values: FloatArray
    phase_rad: FloatArray
    across_rms: FloatArray


def numbers(values: npt.ArrayLike) -> Readings:
    """Readings in double precision, complex where they come so."""
    array = np.asarray(values)
    return array.astype(np.complex128) if np.iscomplexobj(array) else array.astype(np.float64)


def in_phase(readings: Readings) -> InPhase:
    """Readings (N, M) along each mode's principal axis; real ones are left as they are."""
    modes = readings.shape[1]
    if not np.iscomplexobj(readings):
        return InPhase(readings.astype(np.float64), np.zeros(modes), np.zeros(modes))
    phase_rad = np.angle((readings**2).sum(axis=0)) / 2.0
    turned = readings * np.exp(-1j * phase_rad)
    return InPhase(np.ascontiguousarray(turned.real), phase_rad, np.sqrt((turned.imag**2).mean(axis=0)))


def outliers(values: FloatArray, residual: FloatArray) -> npt.NDArray[np.bool_]:
    """Which points (N,) some mode's fit misses by far more than its noise: `values` and `residual` are (N, M)."""
    miss = np.abs(residual)
    sigma = _SIGMA_PER_MEDIAN * np.median(miss, axis=0)
    smallest = _SMALLEST_FRAC * np.sqrt((values**2).mean(axis=0))
    return np.asarray((miss > np.maximum(_FARTHEST_SIGMA * sigma, smallest)).any(axis=1), np.bool_)
