"""A scan of a plate whose glued actuators add waves that a free plate has not: what free-plate modes lack is fitted."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design import CartographyFit
from hapticd.sim.plate.shape_tables import GLUE, waves
from hapticd.values import FloatArray

from .reference_plate import driven_modes, fit_grid

pytestmark = pytest.mark.long

SIZE_MM = (137.5, 137.5)
SCAN_MM = np.arange(-67.5, 67.6, 4.5)
MAP_MM = np.linspace(-68.75, 68.75, 81)
NOISE = 0.01


def glued(x_mm: FloatArray, y_mm: FloatArray, glue_frac: float) -> FloatArray:
    """Return the driven modes (M, ny, nx) with waves of other lengths, as a share of their RMS."""
    shapes = np.stack([shape.on_grid(x_mm, y_mm) for shape in driven_modes()])
    added = np.stack([waves(x_mm, y_mm, SIZE_MM, (1, GLUE, mode)) for mode in range(2)])
    return np.asarray(shapes + glue_frac * np.sqrt(np.mean(shapes**2)) * added, np.float64)


def fitted(glue_frac: float, by: str = "best") -> CartographyFit:
    noise = NOISE * np.random.default_rng(3).standard_normal((2, len(SCAN_MM), len(SCAN_MM)))
    shapes = glued(SCAN_MM, SCAN_MM, glue_frac) + noise
    return fit_grid(SCAN_MM, SCAN_MM, shapes, size_mm=SIZE_MM, by=by)


def error(fit: CartographyFit, glue_frac: float) -> float:
    points = np.stack(np.meshgrid(MAP_MM, MAP_MM), axis=-1).reshape(-1, 2)
    found = fit.modes.evaluate(points).T.reshape(2, len(MAP_MM), len(MAP_MM))
    return float(np.sqrt(np.mean((found - glued(MAP_MM, MAP_MM, glue_frac)) ** 2)))


@pytest.mark.parametrize("glue_frac", [0.04, 0.06])
def test_glue_is_fitted_and_both_residuals_are_reported(glue_frac: float) -> None:
    best = fitted(glue_frac)
    assert best.by == "free_plate"
    added = glue_frac * float(np.sqrt(np.mean(glued(SCAN_MM, SCAN_MM, 0.0) ** 2)))
    assert best.free_plate_rms == pytest.approx([np.hypot(NOISE, added)] * 2, rel=0.25)  # noise and glue
    assert (best.residual_rms < 1.2 * NOISE).all()
    assert error(best, glue_frac) < 0.7 * added
    assert error(best, glue_frac) < error(fitted(glue_frac, "plate_equation"), glue_frac)


def test_a_free_plate_lacks_nothing() -> None:
    best = fitted(0.0)
    assert best.by == "free_plate"
    assert np.isnan(best.free_plate_rms).all()
    assert best.freedom.max() < 40.0
