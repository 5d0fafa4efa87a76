"""Errors of a mode map: smooth surfaces, the most likely first (Karhunen-Loeve), and the shapes of other modes.

The surfaces are the eigenvectors of a Gaussian process: waves of the map's own length, which a noisy scan gets wrong,
and whatever glue, wires and supports do, whose scale is a quarter of that wave. Modes that have turned into each other
since the scan lack some of each other's shapes, over the whole plate.

Source: C. Rasmussen and C. Williams, Gaussian Processes for Machine Learning (2006), 4.2 and 4.3.2.
"""

from __future__ import annotations

import numpy as np

from ...core.plate.bicubic import BicubicSurfaces
from ...core.plate.mode_shapes import ModeShapes
from ...values import FloatArray

MAP_PRIOR = 0.021  # RMS of what smooth surfaces add to a map, as a share of its peak: 5 % of its own RMS
TURNED_PRIOR = 0.06  # of another driven mode's shape in one: they are tens of Hz apart, and turn by some degrees
PARASITIC_PRIOR = 0.015  # of a parasitic mode's, which are farther apart
_OWN_PRIOR = 1e-4  # of its own: touches do not tell a map's scale from the fingers' loads
MOST, _MOST_EACH = 1600, 300  # surfaces of all modes, which a fit takes the square of in time, and of each
_POINTS_A_WAVE = 6.5
_MOST_POINTS = 41  # along an axis
_OWN_SHARE = 0.3  # of the variance: waves of the map's own length
_SCALE = 0.26  # of a wave
_DIRECTIONS = 48
_MARGIN = 0.25  # of a wave: a contact reaches that far beyond its centre


class Waves:
    """K surfaces over the plate, and how far each may be from 0 in each of M modes: `prior` (M, K).

    First are smooth ones, of mean square 1, the likeliest in the box `touched_mm` (2, 2), its least and largest x and
    y, or without one on the whole plate; then the shapes of `modes`, then those of the `parasitic` modes, if known.
    """

    def __init__(
        self,
        modes: ModeShapes,
        wave_rad_mm: float,
        parasitic: ModeShapes | None = None,
        touched_mm: FloatArray | None = None,
    ) -> None:
        wave_mm = 2.0 * np.pi / wave_rad_mm
        x_mm, y_mm = (
            np.linspace(axis[0], axis[-1], min(round(_POINTS_A_WAVE * (axis[-1] - axis[0]) / wave_mm), _MOST_POINTS))
            for axis in (modes.x_mm, modes.y_mm)
        )
        points = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
        least_mm, most_mm = (points.min(axis=0), points.max(axis=0)) if touched_mm is None else touched_mm
        margin_mm = _MARGIN * wave_mm
        is_near = ((points > least_mm - margin_mm) & (points < most_mm + margin_mm)).all(axis=1)
        count = int(is_near.sum())
        far_mm = np.sqrt(((points[:, None] - points[is_near]) ** 2).sum(axis=-1))
        covariance = _OWN_SHARE * _ring(wave_rad_mm, far_mm) + (1.0 - _OWN_SHARE) * _matern(far_mm, _SCALE * wave_mm)
        variance, vectors = np.linalg.eigh(covariance[is_near])
        kept = slice(-1, -1 - min(MOST // modes.M, _MOST_EACH, count), -1)
        # Elsewhere on the plate they are what is most likely by the touched part (Nystroem).
        surfaces = np.sqrt(count) * (covariance @ vectors[:, kept] / np.maximum(variance[kept], 1e-12)).T
        self._surfaces = BicubicSurfaces(x_mm, y_mm, surfaces.reshape(-1, len(y_mm), len(x_mm)))
        self._knots_mm = x_mm, y_mm
        self._shapes = (modes,) if parasitic is None else (modes, parasitic)
        self.smooth = len(surfaces)
        smooth = MAP_PRIOR * np.sqrt(np.maximum(variance[kept], 1e-12) / count)
        turned = np.where(np.eye(modes.M, dtype=bool), _OWN_PRIOR, TURNED_PRIOR)
        aside = np.full((modes.M, 0 if parasitic is None else parasitic.M), PARASITIC_PRIOR)
        self.prior: FloatArray = np.concatenate((np.tile(smooth, (modes.M, 1)), turned, aside), axis=1)

    def __len__(self) -> int:
        return int(self.prior.shape[1])

    def at(self, points_mm: FloatArray) -> FloatArray:
        """Return all surfaces at points (N, 2): (N, K)."""
        shapes = [one.evaluate(points_mm) for one in self._shapes]
        return np.concatenate((self._surfaces.evaluate(points_mm), *shapes), axis=1)

    def slope(self, points_mm: FloatArray) -> FloatArray:
        """Return the gradients of all surfaces at points (N, 2): (N, K, 2)."""
        shapes = [one.gradient(points_mm) for one in self._shapes]
        return np.concatenate((self._surfaces.gradient(points_mm), *shapes), axis=1)

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the sums of `coefficients` (M, K) on a grid: (M, ny, nx)."""
        points = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
        return np.asarray((self.at(points) @ coefficients.T).T.reshape(-1, len(y_mm), len(x_mm)), np.float64)

    def rms(self, coefficients: FloatArray) -> FloatArray:
        """Return the RMS (M,) of the sums of `coefficients` (M, K) over the plate."""
        return np.asarray(np.sqrt((self.on_grid(coefficients, *self._knots_mm) ** 2).mean(axis=(1, 2))), np.float64)

    def of_scale(self, coefficients: FloatArray) -> FloatArray:
        """Return coefficients (M, K) that leave the map's scale, which touches do not tell, and change its form alike.

        The scale is that of all modes together, by regression over the map's grid.
        """
        modes = self._shapes[0]
        change = self.on_grid(coefficients, modes.x_mm, modes.y_mm)
        scale = 1.0 + float(np.vdot(modes.shapes, change) / np.vdot(modes.shapes, modes.shapes))
        return self.scaled(coefficients, np.full(modes.M, 1.0 / scale))

    def scaled(self, coefficients: FloatArray, factors: FloatArray) -> FloatArray:
        """Return coefficients (M, K) by which each mode's shape is so many times (M,) as large."""
        each = np.arange(len(factors))
        scaled = factors[:, None] * coefficients
        scaled[each, self.smooth + each] += factors - 1.0
        return np.asarray(scaled, np.float64)


def _ring(wave_rad_mm: float, far_mm: FloatArray) -> FloatArray:
    """Covariance of waves of one length in all directions: J0, as a mean over them."""
    along = np.cos(np.pi * (np.arange(_DIRECTIONS) + 0.5) / (2.0 * _DIRECTIONS))
    table_mm = np.linspace(0.0, float(far_mm.max()), 2000)
    return np.asarray(np.interp(far_mm, table_mm, np.cos(wave_rad_mm * table_mm[:, None] * along).mean(axis=1)))


def _matern(far_mm: FloatArray, scale_mm: float) -> FloatArray:
    """Covariance of a surface that is differentiable once."""
    far = np.sqrt(3.0) * far_mm / scale_mm
    return np.asarray((1.0 + far) * np.exp(-far), np.float64)


def wave_number(modes: ModeShapes) -> float:
    """Return k in rad/mm with lap w = -k^2 w, by regression over the inner half of the map."""
    inner = [slice(len(axis) // 5, -(len(axis) // 5)) for axis in (modes.y_mm, modes.x_mm)]
    along_y = np.gradient(np.gradient(modes.shapes, modes.y_mm, axis=1), modes.y_mm, axis=1)
    along_x = np.gradient(np.gradient(modes.shapes, modes.x_mm, axis=2), modes.x_mm, axis=2)
    shape, laplacian = modes.shapes[:, *inner], (along_x + along_y)[:, *inner]
    return float(np.sqrt(max(-np.vdot(shape, laplacian) / np.vdot(shape, shape), 1e-6)))
