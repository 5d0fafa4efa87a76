"""Preprocessing of a vibrometer's readings: phase removal per mode, and detection of outliers.

A mode of a lightly damped plate is a standing wave: all points move in phase or in antiphase. Its complex readings lie
on a line through zero at the angle of the drive; what lies across the line is noise, or a second mode.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..values import FloatArray

Readings = npt.NDArray[np.float64] | npt.NDArray[np.complex128]

_SIGMA_PER_MEDIAN = 1.4826  # of normal noise: standard deviation over median size
_FARTHEST_SIGMA = 6.0  # normal noise exceeds it once in 500 million readings
_SMALLEST_FRAC = 0.05  # of the mode's RMS: a smaller miss is harmless, and without noise it is the fit's own error


class InPhase(NamedTuple):
    """Real values (N, M), and per mode (M,) the removed phase in (-pi/2, pi/2] and the RMS of the quadrature."""

    values: FloatArray
    phase_rad: FloatArray
    across_rms: FloatArray


def numbers(values: npt.ArrayLike) -> Readings:
    """Return readings in double precision, complex if they are."""
    array = np.asarray(values)
    return array.astype(np.complex128) if np.iscomplexobj(array) else array.astype(np.float64)


def in_phase(readings: Readings) -> InPhase:
    """Project readings (N, M) on each mode's principal axis; real ones stay unchanged."""
    modes = readings.shape[1]
    if not np.iscomplexobj(readings):
        return InPhase(readings.astype(np.float64), np.zeros(modes), np.zeros(modes))
    phase_rad = np.angle((readings**2).sum(axis=0)) / 2.0
    turned = readings * np.exp(-1j * phase_rad)
    return InPhase(np.ascontiguousarray(turned.real), phase_rad, np.sqrt((turned.imag**2).mean(axis=0)))


def outliers(values: FloatArray, residual: FloatArray) -> npt.NDArray[np.bool_]:
    """Mark points (N,) that some mode's fit misses by far more than its noise; `values`, `residual` are (N, M)."""
    miss = np.abs(residual)
    sigma = _SIGMA_PER_MEDIAN * np.median(miss, axis=0)
    smallest = _SMALLEST_FRAC * np.sqrt((values**2).mean(axis=0))
    return np.asarray((miss > np.maximum(_FARTHEST_SIGMA * sigma, smallest)).any(axis=1), np.bool_)
