"""Fit of a scan by a sum of free-plate modes: a dozen parameters instead of a hundred.

A mode of the real plate is a mixture of the theory's modes of nearly the same frequency. Material and thickness mostly
scale the frequencies, so the modes are selected by wave number. Such
modes also determine the scan's pose on the plate. `cartography` compares the prediction error with that of the
smoothing fit, which needs no free, flat and homogeneous plate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.values import FloatArray

from . import legendre
from .glued_plate import GluedPlate
from .materials import MATERIALS
from .pose import NOMINAL, Pose, find_pose
from .section import wave_hz
from .smoothing import Order, Smoothed

_EXACT = 1e-20  # share of the data's square: a smaller misfit is rounding, which no pose explains
_MIXED_FRAC = 0.01  # of the frequency: modes that are nearer to each other mix
BAND_FRAC = 0.08  # of the frequency: covers modes that the real plate mixes in, and the error of the wave number

# Frequencies of these only label the modes: a plate of another thickness has nearly the same shapes.
_THICKNESS_MM, _MATERIAL = 2.0, MATERIALS["glass"]


def nearest_free_modes(
    modes: ModeShapes, wavelength_mm: float, size_mm: tuple[float, float]
) -> tuple[tuple[str, float], ...]:
    """Return for each mode the most similar free-plate mode near its wavelength: its name, and the squared correlation
    over the map with the best mixture of it and its neighbours in frequency, which patches, supports and tolerances
    mix. () where theory has none.

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
    found = []
    for mode in measured:
        likest = int(np.argmax((mode @ theory) ** 2 / (theory**2).sum(axis=0)))
        near = theory[:, np.abs(free.frequencies_hz / free.frequencies_hz[likest] - 1.0) <= _MIXED_FRAC]
        held = near @ np.linalg.lstsq(near, mode, rcond=None)[0]
        found.append((free.names[likest], float(held @ held / max(mode @ mode, np.finfo(float).tiny))))
    return tuple(found)


class FreeFit(NamedTuple):
    """A fit by free-plate modes, and the scan's pose."""

    fit: Smoothed
    pose: Pose


class FreePlateModes:
    """Basis of the free-plate modes with wave numbers near `wave_rad_mm`, on a plate of `size_mm`: within `band_frac`
    of the frequency. `frequencies_hz` are those of some plate of this size."""

    def __init__(self, size_mm: tuple[float, float], wave_rad_mm: float, band_frac: float = BAND_FRAC) -> None:
        frequency_hz = wave_hz(wave_rad_mm, _THICKNESS_MM, _MATERIAL)
        band_hz = (frequency_hz * (1.0 - band_frac), frequency_hz * (1.0 + band_frac))
        found = GluedPlate(size_mm, _THICKNESS_MM, _MATERIAL).modes(band_hz)
        self._half_mm = np.array(size_mm) / 2.0
        self.frequencies_hz = np.array([hz for hz, _ in found])
        self._shapes = [shape for _, shape in found]
        self.names = tuple(shape.name for shape in self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)

    def at(self, points_mm: FloatArray, order: Order = (0, 0)) -> FloatArray:
        """Return a partial derivative, per mm, of all modes at `points_mm` (N, 2), clamped to the plate: (N, modes)."""
        x, y = np.clip(points_mm / self._half_mm, -1.0, 1.0).T
        coefficients = np.stack([shape.coefficients for shape in self._shapes])  # (modes, nx, ny)
        along_x, along_y = (
            legendre.values(position, degrees - 1, derivative) / half_mm**derivative
            for position, degrees, derivative, half_mm in zip(
                (x, y), coefficients.shape[1:], order, self._half_mm, strict=True
            )
        )
        product: FloatArray = np.einsum("nmj,nj->nm", np.tensordot(along_x, coefficients, axes=(1, 1)), along_y)
        return product

    def fit(self, points_mm: FloatArray, values: FloatArray) -> FreeFit:
        """Fit `values` (N, M) at `points_mm` (N, 2) by least squares; coefficients are (modes, M).

        A pose other than the nominal one is accepted only if its three parameters lower the misfit by what Schwarz's
        criterion requires (G. Schwarz, Ann. Stat. 6 (1978) 461).
        """
        nominal = self._fit(NOMINAL, points_mm, values)
        scale = np.sqrt((values**2).mean(axis=0))
        if ((nominal.fit.residual / scale) ** 2).sum() < _EXACT * values.size:
            return nominal
        moved = self._fit(find_pose(self.at, points_mm, values / scale), points_mm, values)
        misfits = [float(((one.fit.residual / scale) ** 2).sum()) for one in (nominal, moved)]
        price = math.exp(len(Pose._fields) * math.log(values.size) / values.size)
        return moved if misfits[1] * price < misfits[0] else nominal

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the surfaces `coefficients` (modes, M) on a grid: (M, ny, nx)."""
        shapes = np.stack([shape.on_grid(x_mm, y_mm) for shape in self._shapes])
        surfaces: FloatArray = np.tensordot(coefficients.T, shapes, axes=1)
        return surfaces

    def _fit(self, pose: Pose, points_mm: FloatArray, values: FloatArray) -> FreeFit:
        design = self.at(pose.on_plate(points_mm))
        coefficients = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], np.float64)
        surfaces = values.shape[1]
        found = len(self) + (0.0 if pose == NOMINAL else len(pose) / surfaces)
        freedom = np.full(surfaces, float(found))
        return FreeFit(Smoothed(coefficients, freedom, values - design @ coefficients), pose)
