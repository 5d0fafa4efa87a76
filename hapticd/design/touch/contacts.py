"""Sizes of fingers' contacts, by their effect on the plate, and the law of the pad's ellipses that this gives.

A finger loads the plate over its whole contact, so that it damps a mode even where its centre rests on a node: by
`spread_mm2` (`model`). On waves of 32 mm a disc of 4 mm has 4 mm2, one of 7 mm 15.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.plate.contact import disc_points
from ...core.plate.mode_shapes import ModeShapes
from ...values import FloatArray
from .fit import Fit

RADII_MM = np.linspace(1.0, 10.0, 19)
MODEL_MM = 0.4  # by which a fitted radius errs where the touches determine it well: contacts are ellipses, maps err
SCALE_PRIOR, SCALE_SIGMA = 1.0, 0.5
OFFSET_SIGMA_MM = 1.0
KNOWN_MM = 0.6  # of a radius: one sigma of any finger's within 4 .. 7 mm is 0.9
_POINTS = 400
_INNER = 0.85  # of the map: a disc at the edge is cut off


class TouchSizes(NamedTuple):
    """Radius of the disc that each touch has, and its one sigma (T,) in mm."""

    radius_mm: FloatArray
    sigma_mm: FloatArray

    def mean_mm(self) -> tuple[float, float]:
        """Return the mean of these touches by their weight, and one sigma of it."""
        weight = self.sigma_mm**-2.0
        return float((weight * self.radius_mm).sum() / weight.sum()), float(weight.sum() ** -0.5)


class EllipseLaw(NamedTuple):
    """A true axis is `scale` times the one that the pad reports, plus `offset_mm`."""

    scale: float
    offset_mm: float


def contact_sizes(found: Fit, modes: ModeShapes) -> TouchSizes:
    """Return the sizes of the touches that a fit shows."""
    spreads_mm2 = spreads_of(RADII_MM, modes)
    radius_mm = np.interp(found.spread_mm2, spreads_mm2, RADII_MM)
    slope = np.interp(radius_mm, RADII_MM, np.gradient(RADII_MM, spreads_mm2))
    return TouchSizes(radius_mm, np.hypot(slope * found.spread_sigma_mm2, MODEL_MM))


def spreads_of(radii_mm: FloatArray, modes: ModeShapes) -> FloatArray:
    """Return what `model` finds of discs (R,) anywhere on a map, by regression: to second order it is exact."""
    random = np.random.default_rng(1)
    ends = np.array([(axis[0], axis[-1]) for axis in (modes.x_mm, modes.y_mm)])
    points = ends.mean(axis=1) + _INNER * np.ptp(ends, axis=1) * random.uniform(-0.5, 0.5, (_POINTS, 2))
    phi, slope = modes.evaluate(points), modes.gradient(points)
    here, around = np.einsum("nk,nl->nkl", phi, phi).ravel(), np.einsum("nkd,nld->nkl", slope, slope).ravel()
    dx, dy, shares = np.array(disc_points(1.0)).T
    away = np.stack((dx, dy), axis=1)
    found = []
    for radius_mm in radii_mm:
        over = modes.evaluate((points[:, None] + radius_mm * away).reshape(-1, 2)).reshape(_POINTS, len(shares), -1)
        gram = np.einsum("nqk,q,nql->nkl", over, shares, over).ravel()
        centre, rim = np.linalg.lstsq(np.stack((here, around), axis=1), gram, rcond=None)[0]
        found.append(rim / centre)
    return np.asarray(np.maximum.accumulate(found), np.float64)


def ellipse_law(sizes: TouchSizes, reported_mm: FloatArray) -> EllipseLaw | None:
    """Return the law by the axes (T,) that the pad reported of the touches, NaN for none; None where they do not tell.

    Two sizes tell scale and offset; one tells the scale alone, as priors hold the offset near 0.
    """
    has_axis = np.isfinite(reported_mm)
    if not has_axis.any():
        return None
    axes_mm, sigma_mm = reported_mm[has_axis], 2.0 * sizes.sigma_mm[has_axis]
    design = np.stack((axes_mm, np.ones_like(axes_mm)), axis=1) / sigma_mm[:, None]
    known = np.array((SCALE_SIGMA, OFFSET_SIGMA_MM)) ** -2.0
    covariance = np.linalg.inv(design.T @ design + np.diag(known))
    true_mm = 2.0 * sizes.radius_mm[has_axis] / sigma_mm
    scale, offset_mm = covariance @ (design.T @ true_mm + known * np.array((SCALE_PRIOR, 0.0)))
    usual = np.array((float(np.average(axes_mm, weights=sigma_mm**-2.0)), 1.0))
    is_known = 0.5 * float(np.sqrt(usual @ covariance @ usual)) < KNOWN_MM  # of a radius
    return EllipseLaw(float(scale), float(offset_mm)) if is_known and scale > 0.0 else None
