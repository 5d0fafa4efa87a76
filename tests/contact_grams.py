"""Gram matrices of contacts: the mean of phi_k phi_l over each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.contact import disc_points
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.values import FloatArray


def contact_grams(modes: ModeShapes, points_mm: npt.ArrayLike, radius_mm: float) -> FloatArray:
    """Return G (N, M, M) of discs of `radius_mm` about `points_mm` (N, 2), for `solve(..., gram=)`."""
    points, disc = np.asarray(points_mm, np.float64), np.array(disc_points(radius_mm))
    shapes = modes.evaluate((points[:, None] + disc[:, :2]).reshape(-1, 2)).reshape(len(points), len(disc), modes.M)
    return np.asarray(np.einsum("nqk,q,nql->nkl", shapes, disc[:, 2], shapes))
