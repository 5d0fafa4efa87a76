"""A scan as a sum of free-plate modes: a dozen numbers, not a hundred, where the plate is what theory takes it for.

A mode of the real plate is a mixture of the theory's modes of nearly the same frequency. Material and thickness only
set the scale of frequencies, so the modes are chosen by wave number, and of the material only Poisson's ratio shows.
Whether a plate is free, flat and square enough for this, its own scan must tell: `cartography` compares the
prediction error with that of the plain smoothing fit.
"""

from __future__ import annotations

import math

import numpy as np

from .free_plate import free_plate_modes
from .legendre import FloatArray
from .smoothing import Smoothed

_BAND_FRAC = 0.08  # of the frequency: neighbours that the real plate can mix in, and the error of the wave number

# Frequencies of these only label the modes: any thin plate of the same Poisson's ratio has the same shapes.
_THICKNESS_MM, _YOUNG_GPA, _POISSON, _DENSITY_KG_M3 = 2.0, 72.5, 0.22, 2500.0
_STIFFNESS_NM = _YOUNG_GPA * 1e9 * (_THICKNESS_MM * 1e-3) ** 3 / (12.0 * (1.0 - _POISSON**2))
_WAVE_SPEED_M2_S = math.sqrt(_STIFFNESS_NM / (_DENSITY_KG_M3 * _THICKNESS_MM * 1e-3))


class FreePlateModes:
    """The free-plate modes whose wave number is near `wave_rad_mm`, as a basis for surfaces on a plate of `size_mm`."""

    def __init__(self, size_mm: tuple[float, float], wave_rad_mm: float) -> None:
        frequency_hz = _WAVE_SPEED_M2_S * (wave_rad_mm * 1e3) ** 2 / (2.0 * math.pi)
        band_hz = (frequency_hz * (1.0 - _BAND_FRAC), frequency_hz * (1.0 + _BAND_FRAC))
        found = free_plate_modes(size_mm, _THICKNESS_MM, _YOUNG_GPA, _POISSON, _DENSITY_KG_M3, band_hz)
        self._shapes = [shape for _, shape in found]

    def __len__(self) -> int:
        return len(self._shapes)

    def fit(self, x_mm: FloatArray, y_mm: FloatArray, values: FloatArray) -> Smoothed:
        """Least squares of `values` (N, M) at points (N,), (N,); coefficients are (modes, M)."""
        points = np.stack((x_mm, y_mm), axis=-1)
        design = np.stack([shape.evaluate(points) for shape in self._shapes], axis=-1)
        coefficients = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], np.float64)
        residual_rms = np.sqrt(((values - design @ coefficients) ** 2).mean(axis=0))
        spare = 1.0 - len(self) / len(values)
        freedom = np.full(values.shape[1], float(len(self)))
        return Smoothed(coefficients, freedom, residual_rms, residual_rms / math.sqrt(spare), residual_rms / spare)

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """The surfaces `coefficients` (modes, M) on a grid: (M, ny, nx)."""
        shapes = np.stack([shape.on_grid(x_mm, y_mm) for shape in self._shapes])
        surfaces: FloatArray = np.tensordot(coefficients.T, shapes, axes=1)
        return surfaces
