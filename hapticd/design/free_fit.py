"""A scan as a sum of free-plate modes: a dozen numbers, not a hundred, where the plate is what theory takes it for.

A mode of the real plate is a mixture of the theory's modes of nearly the same frequency. Material and thickness only
set the scale of frequencies, so the modes are chosen by wave number, and of the material only Poisson's ratio shows.
Such modes also show how the scan lies on the plate (`pose`). Whether a plate is free, flat and square enough for this,
its own scan must tell: `cartography` compares the prediction error with that of the plain smoothing fit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes

from . import legendre
from .free_plate import free_plate_modes
from .legendre import FloatArray
from .pose import AS_TOLD, Pose, find_pose
from .smoothing import Order, Smoothed

_EXACT = 1e-20  # share of the data's square: a misfit below is rounding, which no pose explains
_BAND_FRAC = 0.08  # of the frequency: neighbours that the real plate can mix in, and the error of the wave number

# Frequencies of these only label the modes: any thin plate of the same Poisson's ratio has the same shapes.
_THICKNESS_MM, _YOUNG_GPA, _POISSON, _DENSITY_KG_M3 = 2.0, 72.5, 0.22, 2500.0
_STIFFNESS_NM = _YOUNG_GPA * 1e9 * (_THICKNESS_MM * 1e-3) ** 3 / (12.0 * (1.0 - _POISSON**2))
_WAVE_SPEED_M2_S = math.sqrt(_STIFFNESS_NM / (_DENSITY_KG_M3 * _THICKNESS_MM * 1e-3))


def nearest_free_modes(
    modes: ModeShapes, wavelength_mm: float, size_mm: tuple[float, float]
) -> tuple[tuple[str, float], ...]:
    """Of each mode the free-plate mode of about its wavelength that it is most like: its name, and their correlation
    squared over the map, 1 for the same shape. () where theory has none.

    Source of the measure: R. J. Allemang and D. L. Brown, Proc. 1st Int. Modal Analysis Conf. (1982) 110.
    """
    try:
        free = FreePlateModes(size_mm, 2.0 * math.pi / wavelength_mm)
    except ValueError:
        return ()
    if not len(free):
        return ()
    points = np.stack(np.meshgrid(modes.x_mm, modes.y_mm), axis=-1).reshape(-1, 2)
    theory, measured = free.at(points), modes.shapes.reshape(modes.M, -1)
    sizes = np.outer((measured**2).sum(axis=1), (theory**2).sum(axis=0))
    alike = (measured @ theory) ** 2 / np.maximum(sizes, np.finfo(float).tiny)
    return tuple((free.names[int(np.argmax(row))], float(row.max())) for row in alike)


class FreeFit(NamedTuple):
    """A fit by free-plate modes, and how the scan lies on the plate for it."""

    fit: Smoothed
    pose: Pose


class FreePlateModes:
    """The free-plate modes whose wave number is near `wave_rad_mm`, as a basis for surfaces on a plate of `size_mm`."""

    def __init__(self, size_mm: tuple[float, float], wave_rad_mm: float) -> None:
        frequency_hz = _WAVE_SPEED_M2_S * (wave_rad_mm * 1e3) ** 2 / (2.0 * math.pi)
        band_hz = (frequency_hz * (1.0 - _BAND_FRAC), frequency_hz * (1.0 + _BAND_FRAC))
        found = free_plate_modes(size_mm, _THICKNESS_MM, _YOUNG_GPA, _POISSON, _DENSITY_KG_M3, band_hz)
        self._half_mm = np.array(size_mm) / 2.0
        self._shapes = [shape for _, shape in found]
        self.names = tuple(shape.name for shape in self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)

    def tables(self) -> FloatArray:
        """The modes as coefficients of Legendre products, (modes, nx, ny); see `free_plate.ModeShape`."""
        return np.stack([shape.coefficients for shape in self._shapes])

    def at(self, points_mm: FloatArray, order: Order = (0, 0)) -> FloatArray:
        """A partial derivative, per mm, of all modes at `points_mm` (N, 2): (N, modes). Beyond an edge, the edge's."""
        x, y = np.clip(points_mm / self._half_mm, -1.0, 1.0).T
        coefficients = self.tables()
        along_x, along_y = (
            legendre.values(position, degrees - 1, derivative) / half_mm**derivative
            for position, degrees, derivative, half_mm in zip(
                (x, y), coefficients.shape[1:], order, self._half_mm, strict=True
            )
        )
        product: FloatArray = np.einsum("nmj,nj->nm", np.tensordot(along_x, coefficients, axes=(1, 1)), along_y)
        return product

    def fit(self, points_mm: FloatArray, values: FloatArray) -> FreeFit:
        """Least squares of `values` (N, M) at `points_mm` (N, 2) of the scan; coefficients are (modes, M).

        The scan is taken to lie as it says unless turning and shifting it wins more than chance would: three numbers
        must lower the misfit by what Schwarz's criterion asks of them (G. Schwarz, Ann. Stat. 6 (1978) 461).
        """
        as_told = self._fit(AS_TOLD, points_mm, values)
        scale = np.sqrt((values**2).mean(axis=0))
        if ((as_told.fit.residual / scale) ** 2).sum() < _EXACT * values.size:
            return as_told
        moved = self._fit(find_pose(self, points_mm, values / scale), points_mm, values)
        misfits = [float(((one.fit.residual / scale) ** 2).sum()) for one in (as_told, moved)]
        price = math.exp(len(Pose._fields) * math.log(values.size) / values.size)
        return moved if misfits[1] * price < misfits[0] else as_told

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """The surfaces `coefficients` (modes, M) on a grid: (M, ny, nx)."""
        shapes = np.stack([shape.on_grid(x_mm, y_mm) for shape in self._shapes])
        surfaces: FloatArray = np.tensordot(coefficients.T, shapes, axes=1)
        return surfaces

    def _fit(self, pose: Pose, points_mm: FloatArray, values: FloatArray) -> FreeFit:
        design = self.at(pose.on_plate(points_mm))
        coefficients = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], np.float64)
        surfaces = values.shape[1]
        found = len(self) + (0.0 if pose == AS_TOLD else len(pose) / surfaces)
        freedom = np.full(surfaces, float(found))
        return FreeFit(Smoothed(coefficients, freedom, values - design @ coefficients), pose)
