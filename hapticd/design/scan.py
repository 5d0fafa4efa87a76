"""Simulated vibrometer scans of known shapes, with noise, lost points, outliers and a pose: test input for the fits.

Left out: correlated errors, noise that depends on the position, and drift of the plate's temperature during the scan.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..values import FloatArray
from .free_fit import NOMINAL, Pose
from .mode_shape import ModeShape


def sample_cartography(
    modes: Sequence[ModeShape],
    step_mm: float = 4.5,
    noise_frac: float = 0.02,
    seed: int | tuple[int, ...] = 1,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a scan on a grid: `x_mm` (nx,), `y_mm` (ny,), shapes (M, ny, nx) with noise.

    The grid is centred on the plate and stays on it. Noise is normal and independent, of `noise_frac` of the peak
    (RMS). The same seed gives the same scan.
    """
    random = np.random.default_rng(seed)
    x_mm, y_mm = (_scan_axis(edge_mm, step_mm) for edge_mm in modes[0].size_mm)
    shapes = np.stack([mode.on_grid(x_mm, y_mm) for mode in modes])
    shapes += noise_frac * random.standard_normal(shapes.shape)
    return x_mm, y_mm, shapes


def sample_scan(
    modes: Sequence[ModeShape],
    *,
    step_mm: float = 4.5,
    noise_frac: float = 0.02,
    seed: int | Sequence[int] = 1,
    missing_frac: float = 0.0,
    dropout_frac: float = 0.0,
    pose: Pose = NOMINAL,
    scale: Sequence[complex] | None = None,
) -> tuple[FloatArray, npt.NDArray[np.complex128]]:
    """Return a scan as points in random order: nominal `points_mm` (N, 2) and complex readings (N, M).

    `pose` puts the grid on the plate; points off the plate give no reading and are left out, like lost ones. A
    `dropout_frac` of the others reads a random value of the shapes' size instead. Each mode is multiplied by its
    `scale`; either quadrature has noise of `noise_frac` of the peak.
    """
    random = np.random.default_rng(seed)
    x_mm, y_mm = (_scan_axis(edge_mm, step_mm) for edge_mm in modes[0].size_mm)
    points = random.permutation(np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2))
    where = pose.on_plate(points)
    read = (np.abs(where) <= np.array(modes[0].size_mm) / 2.0).all(axis=1) & (
        random.random(len(points)) >= missing_frac
    )
    points, where = points[read], where[read]
    shapes = np.stack([mode.evaluate(where) for mode in modes], axis=-1)
    lost = random.random(len(points)) < dropout_frac
    shapes[lost] = random.uniform(-1.0, 1.0, (int(lost.sum()), len(modes)))
    noise = random.standard_normal((2, *shapes.shape)) * noise_frac
    readings = (shapes + noise[0] + 1j * noise[1]) * (np.ones(len(modes)) if scale is None else np.array(scale))
    return points, np.asarray(readings, np.complex128)


def _scan_axis(edge_mm: float, step_mm: float) -> FloatArray:
    count = math.floor(edge_mm / 2.0 / step_mm + 1e-9)
    return np.asarray(step_mm * np.arange(-count, count + 1), np.float64)
