"""What free-plate modes lack of a scan: glue, patches and supports add waves that a free plate has not.

The residual of the free-plate fit is smoothed by polynomials over the plate, with a penalty on their mean square and on
third derivatives in units of the plate's own wave number: waves of about its length are what mass and stiffness at some
places excite. Cross validation weighs it for each mode alone, and takes nothing where there is only noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..values import FloatArray
from .free_fit import FreeFit, FreePlateModes
from .smoothing import PlateBasis, ScatteredData, Smoothed, third_derivatives

_LEAST_FALL = 2e-3  # of the prediction error: less is what noise gives


@dataclass(frozen=True, slots=True)
class CorrectedModes:
    """Free-plate modes, and polynomials for what they lack; coefficients (modes + products, M) have both."""

    free: FreePlateModes
    basis: PlateBasis

    def on_grid(self, coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the surfaces on a grid: (M, ny, nx)."""
        of_free, lacking = np.split(coefficients, [len(self.free)])
        return self.free.on_grid(of_free, x_mm, y_mm) + self.basis.on_grid(lacking, x_mm, y_mm)


def corrected(
    basis: PlateBasis, wave_rad_mm: float, modes: FreePlateModes, found: FreeFit, points_mm: FloatArray
) -> tuple[CorrectedModes, Smoothed] | None:
    """Return the fit with what the free-plate modes lack at `points_mm` (N, 2); None if cross validation finds nothing.

    The correction of each mode has the parameters that its data determine, in addition to those of the free plate.
    """
    penalty = basis.energy((0, 0), (0, 0)) + third_derivatives(basis, wave_rad_mm)
    x_mm, y_mm = found.pose.on_plate(points_mm).T
    scan = ScatteredData(basis, x_mm, y_mm, found.fit.residual)
    try:
        lacking = scan.smooth(penalty)
    except np.linalg.LinAlgError:  # waves much longer than the polynomials resolve: rounding hides all but the penalty
        return None
    coefficients = np.concatenate((found.fit.coefficients, lacking.coefficients))
    both = Smoothed(coefficients, found.fit.freedom + lacking.freedom, lacking.residual)
    before, after = (float((one.prediction_rms**2).sum()) for one in (found.fit, both))
    return (CorrectedModes(modes, basis), both) if after < (1.0 - _LEAST_FALL) ** 2 * before else None
