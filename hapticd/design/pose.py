"""How a scan lies on the plate: a vibrometer's axes are never quite the plate's.

A free plate's modes know where the plate's edges are, so the scan itself tells by how much it is turned and shifted:
the pose and the modes' shares that leave the least squared misfit. The shares enter linearly and are eliminated
(variable projection); what is left are three numbers, found by Gauss and Newton's steps. From the nominal pose they
converge for 5 degrees and 4 mm on the reference plate; a half-wavelength (13 mm at the rim) would be another minimum.

Sources: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; L. Kaufman, BIT 15 (1975) 49 (projected slopes).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .legendre import FloatArray

if TYPE_CHECKING:
    from .free_fit import FreePlateModes

_MOST_STEPS = 20  # four are usual
_MOST_HALVINGS = 10
_SETTLED = 1e-9  # share of the misfit that one more step must win


class Pose(NamedTuple):
    """A point of the scan, turned by `rotation_rad` about the plate's centre and then shifted, is where it lies."""

    rotation_rad: float
    x_mm: float
    y_mm: float

    def on_plate(self, points_mm: FloatArray) -> FloatArray:
        """The scan's `points_mm` (N, 2) in the plate's frame."""
        cos, sin = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        x, y = points_mm.T
        return np.stack((cos * x - sin * y + self.x_mm, sin * x + cos * y + self.y_mm), axis=-1)

    def moved(self, step: FloatArray) -> Pose:
        """The pose with `step` (3,) added to its numbers."""
        rotation_rad, x_mm, y_mm = step.tolist()
        return Pose(self.rotation_rad + rotation_rad, self.x_mm + x_mm, self.y_mm + y_mm)


AS_TOLD = Pose(0.0, 0.0, 0.0)


def find_pose(modes: FreePlateModes, points_mm: FloatArray, values: FloatArray) -> Pose:
    """The pose in which sums of `modes` fit `values` (N, M) at the scan's `points_mm` (N, 2) best, from the nominal."""
    pose, misfit = AS_TOLD, math.inf
    step = np.zeros(3)
    for _ in range(_MOST_STEPS):
        for _ in range(_MOST_HALVINGS):
            now, next_step = _misfit_and_step(modes, pose.moved(step), points_mm, values)
            if now < misfit:
                break
            step = step / 2.0
        if not now < misfit * (1.0 - _SETTLED):
            return pose
        pose, misfit, step = pose.moved(step), now, next_step
    return pose


def _misfit_and_step(
    modes: FreePlateModes, pose: Pose, points_mm: FloatArray, values: FloatArray
) -> tuple[float, FloatArray]:
    """The squared misfit in a pose, and the step (3,) that a linear model of it takes."""
    points = pose.on_plate(points_mm)
    design = modes.at(points)
    span, _ = np.linalg.qr(design)
    coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
    residual = values - design @ coefficients
    along_x, along_y = (modes.at(points, order) @ coefficients for order in ((1, 0), (0, 1)))
    arm_x, arm_y = (points - (pose.x_mm, pose.y_mm)).T  # turning moves a point across its arm
    turned = along_y * arm_x[:, None] - along_x * arm_y[:, None]
    slopes = np.stack((turned, along_x, along_y), axis=-1)
    slopes -= np.tensordot(span, np.tensordot(span.T, slopes, axes=1), axes=1)
    step = np.linalg.lstsq(slopes.reshape(-1, 3), residual.ravel(), rcond=None)[0]
    return float(np.vdot(residual, residual)), step
