"""Where the pad lies on the plate: the affine map of least squares from touched marks, and how good it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...errors import CalibrationError
from ...values import AffineMap

MIN_MARKS = 4  # three decide the map, and only a fourth tells how good it is
MIN_SPREAD_MM = 5.0  # RMS of the marks about the line that fits them best

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AffineFit:
    """The map from pad to plate, the marks minus what it makes of the touches `residual_mm` (N, 2), and by how much it
    misses each mark when that one is not used for the fit, `left_out_mm` (N,)."""

    plate_from_pad: AffineMap
    residual_mm: Array
    left_out_mm: Array

    @property
    def left_out_rms_mm(self) -> float:
        """Of all marks."""
        return float(np.sqrt((self.left_out_mm**2).mean()))


@dataclass(frozen=True, slots=True)
class Placement:
    """The same map in a person's words: A = R(rotation) (1 shear; 0 1) diag(scale), anticlockwise.

    `scale_y` is negative where the pad is mirrored.
    """

    rotation_deg: float
    scale_x: float
    scale_y: float
    shear: float


def fit_affine(pad_mm: npt.ArrayLike, plate_mm: npt.ArrayLike) -> AffineFit:
    """The map that takes touches `pad_mm` (N, 2) to marks `plate_mm` (N, 2) best.

    Raises CalibrationError for fewer than MIN_MARKS, marks on one line, or numbers that are not finite.
    """
    pad, plate = np.asarray(pad_mm, np.float64), np.asarray(plate_mm, np.float64)
    if pad.shape != plate.shape or pad.ndim != 2 or pad.shape[1] != 2 or len(pad) < MIN_MARKS:
        raise CalibrationError(f"Give {MIN_MARKS} marks or more, and touch each of them.")
    if not (np.isfinite(pad).all() and np.isfinite(plate).all()):
        raise CalibrationError("A mark or a touch is no finite position: repeat it.")
    for what, points in (("marks", plate), ("touches", pad)):
        across_mm = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / math.sqrt(len(points))
        if not across_mm >= MIN_SPREAD_MM:
            raise CalibrationError(f"The {what} lie close to one line: spread them over the plate.")
    design = np.column_stack((pad, np.ones(len(pad))))
    solution = np.linalg.lstsq(design, plate, rcond=None)[0]
    residual_mm = plate - design @ solution
    hat = np.einsum("ni,in->n", design, np.linalg.pinv(design))
    left_out_mm = np.hypot(*residual_mm.T) / np.maximum(1.0 - hat, 1e-9)
    (xx, yx), (xy, yy), (x_mm, y_mm) = solution.tolist()
    return AffineFit(AffineMap(xx, xy, yx, yy, x_mm, y_mm), residual_mm, left_out_mm)


def placement(found: AffineMap) -> Placement:
    """Rotation, scales and shear of a map that can be inverted."""
    scale_x = math.hypot(found.xx, found.yx)
    cos, sin = found.xx / scale_x, found.yx / scale_x
    scale_y = cos * found.yy - sin * found.xy
    return Placement(math.degrees(math.atan2(sin, cos)), scale_x, scale_y, (cos * found.xy + sin * found.yy) / scale_y)
