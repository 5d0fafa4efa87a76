"""A vibrometer's scan of known shapes, with what goes wrong in a laboratory: the input that a fit is judged on.

Left out: readings that lie (a speck that reflects the neighbouring point), noise that depends on the place, and drift
of the plate's temperature while the scan runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .free_plate import ModeShape
from .legendre import FloatArray
from .pose import AS_TOLD, Pose


def sample_cartography(
    modes: Sequence[ModeShape],
    step_mm: float = 4.5,
    noise_frac: float = 0.02,
    seed: int = 1,
    missing_frac: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What a vibrometer would read: `x_mm` (nx,), `y_mm` (ny,), shapes (M, ny, nx) with noise and NaN.

    The grid is centred on the plate and stays on it. Noise is normal and independent, `noise_frac` of the peak RMS.
    A point is lost with a chance of `missing_frac`, and then in all modes: it is a speck that reflects badly. The
    same seed gives the same scan.
    """
    random = np.random.default_rng(seed)
    x_mm, y_mm = (_scan_axis(edge_mm, step_mm) for edge_mm in modes[0].size_mm)
    shapes = np.stack([mode.on_grid(x_mm, y_mm) for mode in modes])
    shapes += noise_frac * random.standard_normal(shapes.shape)
    shapes[:, random.random(shapes.shape[1:]) < missing_frac] = np.nan
    return x_mm, y_mm, shapes


def sample_scan(
    modes: Sequence[ModeShape],
    *,
    step_mm: float = 4.5,
    noise_frac: float = 0.02,
    seed: int = 1,
    missing_frac: float = 0.0,
    dropout_frac: float = 0.0,
    pose: Pose = AS_TOLD,
    scale: Sequence[complex] | None = None,
) -> tuple[FloatArray, npt.NDArray[np.complex128]]:
    """The same as points in no order: `points_mm` (N, 2), as the scan tells them, and complex readings (N, M).

    The points lie on the plate where `pose` puts the grid; what it puts beside the plate gives no reading and is left
    out, like points lost. A `dropout_frac` of the others reads something random of the shapes' size instead. Each mode
    is multiplied by its `scale`; noise, of `noise_frac` of the peak, is of either quadrature.
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
