"""Pose of a scan on the plate: rotation and shift of the vibrometer's axes against the plate's.

Free-plate modes depend on the position of the plate's edges, so the scan itself determines its pose: the one that, with
the best mode coefficients, leaves the least squared misfit. The coefficients enter linearly and are eliminated
(variable projection); the three remaining parameters are found by Gauss-Newton steps. From the nominal pose these
converge for 5 degrees and 4 mm on the reference plate; half a wavelength (13 mm at the rim) is another minimum.

Sources: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; L. Kaufman, BIT 15 (1975) 49 (projected slopes).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..values import FloatArray
from .smoothing import Order

Basis = Callable[[FloatArray, Order], FloatArray]  # a partial derivative of all modes at points (N, 2): (N, modes)

_MOST_STEPS = 20  # four are usual
_MOST_HALVINGS = 10
_SETTLED = 1e-9  # least share of the misfit that a step must remove


class Pose(NamedTuple):
    """Rotation about the plate's centre, then a shift: takes the scan's points to the plate's frame."""

    rotation_rad: float
    x_mm: float
    y_mm: float

    def on_plate(self, points_mm: FloatArray) -> FloatArray:
        """Return the scan's `points_mm` (N, 2) in the plate's frame."""
        cos, sin = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        x, y = points_mm.T
        return np.stack((cos * x - sin * y + self.x_mm, sin * x + cos * y + self.y_mm), axis=-1)

    def moved(self, step: FloatArray) -> Pose:
        """Return the pose with `step` (3,) added."""
        rotation_rad, x_mm, y_mm = step.tolist()
        return Pose(self.rotation_rad + rotation_rad, self.x_mm + x_mm, self.y_mm + y_mm)


NOMINAL = Pose(0.0, 0.0, 0.0)


def find_pose(basis: Basis, points_mm: FloatArray, values: FloatArray) -> Pose:
    """Return the pose in which sums of `basis` best fit `values` (N, M) at `points_mm` (N, 2), from the nominal one."""
    pose, misfit = NOMINAL, math.inf
    step = np.zeros(3)
    for _ in range(_MOST_STEPS):
        for _ in range(_MOST_HALVINGS):
            now, next_step = _misfit_and_step(basis, pose.moved(step), points_mm, values)
            if now < misfit:
                break
            step = step / 2.0
        if not now < misfit * (1.0 - _SETTLED):
            return pose
        pose, misfit, step = pose.moved(step), now, next_step
    return pose


def _misfit_and_step(basis: Basis, pose: Pose, points_mm: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Return the squared misfit of a pose, and its Gauss-Newton step (3,)."""
    points = pose.on_plate(points_mm)
    design = basis(points, (0, 0))
    span, _ = np.linalg.qr(design)
    coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
    residual = values - design @ coefficients
    along_x, along_y = (basis(points, order) @ coefficients for order in ((1, 0), (0, 1)))
    arm_x, arm_y = (points - (pose.x_mm, pose.y_mm)).T  # a rotation moves a point across its arm
    turned = along_y * arm_x[:, None] - along_x * arm_y[:, None]
    slopes = np.stack((turned, along_x, along_y), axis=-1)
    slopes -= np.tensordot(span, np.tensordot(span.T, slopes, axes=1), axes=1)
    step = np.linalg.lstsq(slopes.reshape(-1, 3), residual.ravel(), rcond=None)[0]
    return float(np.vdot(residual, residual)), step
