"""Marks touched on the plate: detection of a resting finger, and the affine map from pad to plate.

Pure: touch frames in, positions and fits out. A mark's position is the mean over the rest, which reduces a pad's noise
of 0.05 mm to 0.01 mm; a person's aim is worse, and shows in the fit's residual.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...core.touch.fingers import Tracker
from ...errors import CalibrationError
from ...values import AffineMap, Finger, FloatArray, TouchFrame

REST_NS = 500_000_000
REST_WITHIN_MM = 0.5  # of the mean, for the whole rest
APART_MM = 5.0  # from other fingers and from marks touched before
LEAST_FRAMES = 10  # of a rest: a pad that loses more shows no rest
MIN_MARKS = 4  # three determine the map, a fourth its error
MIN_SPREAD_MM = 5.0  # RMS of the marks about the line that fits them best

MarkPoint = tuple[float, float]


class TouchedMarks:
    """Positions touched so far, in order, in the pad's frame."""

    def __init__(self) -> None:
        self.rests_mm: list[MarkPoint] = []
        self._tracker = Tracker()
        self._paths: dict[int, deque[tuple[int, float, float]]] = {}
        self._counted: set[int] = set()

    def update(self, frame: TouchFrame) -> MarkPoint | None:
        """Return the position at which a finger completed its rest with this frame, None without one."""
        now = self._tracker.update(frame)
        for lifted in now.lifted:
            self._paths.pop(lifted, None)
        for finger in now.fingers:
            path = self._paths.setdefault(finger.finger_id, deque())
            if not path or now.t_ns > path[-1][0]:
                path.append((now.t_ns, finger.x_mm, finger.y_mm))
            while now.t_ns - path[0][0] > REST_NS:
                path.popleft()
        for finger in now.fingers:
            if (rest := self._rest(finger, now.fingers, now.t_ns)) is not None:
                self._counted.add(finger.finger_id)
                self.rests_mm.append(rest)
                return rest
        return None

    def _rest(self, finger: Finger, fingers: tuple[Finger, ...], t_ns: int) -> MarkPoint | None:
        path = self._paths[finger.finger_id]
        period_ns = (t_ns - path[0][0]) // max(len(path) - 1, 1)
        is_whole = len(path) >= LEAST_FRAMES and t_ns - path[0][0] + period_ns >= REST_NS
        if not is_whole or finger.finger_id in self._counted:
            return None
        points_mm = np.array([place_mm for _, *place_mm in path])
        mean_mm = points_mm.mean(axis=0)
        others_mm = [(one.x_mm, one.y_mm) for one in fingers if one is not finger] + self.rests_mm
        is_apart = all(np.hypot(*(mean_mm - other)) >= APART_MM for other in others_mm)
        if not is_apart or np.hypot(*(points_mm - mean_mm).T).max() > REST_WITHIN_MM:
            return None
        return float(mean_mm[0]), float(mean_mm[1])


@dataclass(frozen=True, slots=True)
class AffineFit:
    """The map from pad to plate; the marks minus the mapped touches, `residual_mm` (N, 2); and the error at each mark
    when that one is left out of the fit, `left_out_mm` (N,)."""

    plate_from_pad: AffineMap
    residual_mm: FloatArray
    left_out_mm: FloatArray

    @property
    def left_out_rms_mm(self) -> float:
        """RMS over all marks."""
        return float(np.sqrt((self.left_out_mm**2).mean()))


class _Placement(NamedTuple):
    """Decomposition of an affine map: A = R(rotation) (1 shear; 0 1) diag(scale), rotation anticlockwise; `scale_y` is
    negative for a mirrored pad."""

    rotation_deg: float
    scale_x: float
    scale_y: float
    shear: float


def fit_affine(pad_mm: npt.ArrayLike, plate_mm: npt.ArrayLike) -> AffineFit:
    """Fit the map that takes touches `pad_mm` (N, 2) to marks `plate_mm` (N, 2) by least squares.

    Raises CalibrationError for fewer than MIN_MARKS, marks on one line, or numbers that are not finite.
    """
    pad, plate = np.asarray(pad_mm, np.float64), np.asarray(plate_mm, np.float64)
    if pad.shape != plate.shape or len(pad) < MIN_MARKS:
        raise CalibrationError(f"Give {MIN_MARKS} marks or more, and touch each of them.")
    if not np.isfinite((pad, plate)).all():
        raise CalibrationError("A mark or a touch has no finite position: repeat it.")
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


def placement(found: AffineMap) -> _Placement:
    """Return rotation, scales and shear of an invertible map."""
    scale_x = math.hypot(found.xx, found.yx)
    cos, sin = found.xx / scale_x, found.yx / scale_x
    scale_y = cos * found.yy - sin * found.xy
    return _Placement(math.degrees(math.atan2(sin, cos)), scale_x, scale_y, (cos * found.xy + sin * found.yy) / scale_y)
