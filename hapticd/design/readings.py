"""Readings of a vibrometer before the fit: checks that say what to do, phase removal per mode, and outliers.

A mode of a lightly damped plate is a standing wave: all points move in phase or in antiphase. Its complex readings lie
on a line through zero at the angle of the drive; what lies across the line is noise, or a second mode.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..errors import ModesError
from ..values import FloatArray

Readings = npt.NDArray[np.float64] | npt.NDArray[np.complex128]

MIN_LINES = 8  # per axis: fewer cannot hold a wave and its surroundings

_MOST_SHIFT_MM = 5.0  # a shifted scan may reach this far beyond the plate
_LEAST_COVER_FRAC = 0.5  # of an edge: a smaller scan has other units, or another plate's size
_MAX_VALUE = 1e12  # larger is a damaged file, and squares could overflow
_MIN_VALUE = 1e-60  # smaller counts as zero: its square could vanish
_SIGMA_PER_MEDIAN = 1.4826  # of normal noise: standard deviation over median size
_FARTHEST_SIGMA = 6.0  # normal noise exceeds it once in 500 million readings
_SMALLEST_FRAC = 0.05  # of the mode's RMS: a smaller miss is harmless, and without noise it is the fit's own error


class InPhase(NamedTuple):
    """Real values (N, M), and per mode (M,) the removed phase in (-pi/2, pi/2] and the RMS of the quadrature."""

    values: FloatArray
    phase_rad: FloatArray
    across_rms: FloatArray


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


def require_scan(
    points_mm: FloatArray, readings: Readings, lines: tuple[int, int], size_mm: tuple[float, float]
) -> None:
    """Check points (N, 2) on the plate and readings (N, M); raises ModesError."""
    if min(lines) < MIN_LINES or readings.shape[1] < 1:
        raise ModesError(f"{len(points_mm)} points are too few; measure at least {MIN_LINES} lines by {MIN_LINES}.")
    if not np.isfinite(points_mm).all():
        raise ModesError("a point's position is not a number; give it or remove the point.")
    for position_mm, name, edge_mm in zip(points_mm.T, ("x_mm", "y_mm"), size_mm, strict=True):
        low, high = float(position_mm.min()), float(position_mm.max())
        if high - low < _LEAST_COVER_FRAC * edge_mm:
            raise ModesError(
                f"{name} runs from {low:g} to {high:g}, less than half of a plate of {edge_mm:g} mm; "
                "give positions in mm, or the plate's size."
            )
        if not (-edge_mm / 2.0 - _MOST_SHIFT_MM <= low and high <= edge_mm / 2.0 + _MOST_SHIFT_MM):
            raise ModesError(
                f"{name} runs from {low:g} to {high:g} mm, off a plate of {edge_mm:g} mm; "
                "give the plate's size, or measure positions from its centre."
            )
    if (np.abs(readings) > _MAX_VALUE).any():
        raise ModesError("a shape is infinite or absurdly large somewhere; measure that point again or leave it empty.")
    if np.isfinite(readings).all(axis=1).mean() < 0.5:
        raise ModesError("more than half of the points have no value in some mode; measure them again.")
    for mode, shape in enumerate(readings.T, 1):
        if not np.nanmax(np.abs(shape)) > _MIN_VALUE:
            raise ModesError(f"mode {mode} is zero everywhere; remove it or measure it again.")
