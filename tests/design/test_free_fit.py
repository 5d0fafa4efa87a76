"""The fit by free-plate modes, and the pose that it finds: used where the plate is free, and only there."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from hapticd.design import (
    CartographyFit,
    ModeShape,
    Pose,
    fit_scan,
    free_plate_modes,
    sample_scan,
)
from hapticd.design.smoothing import PlateBasis, ScatteredData, plate_equation, third_derivatives

from .reference_plate import driven_modes, fit_grid, grid_points

pytestmark = pytest.mark.long

WAVE_RAD_MM = 2.0 * math.pi / 26.2
NOISE = 0.02
SQUARE_MM = (137.5, 137.5)
OBLONG_MM = (120.0, 80.0)


@cache
def neighbours(size_mm: tuple[float, float], band_hz: tuple[float, float]) -> list[ModeShape]:
    return [shape for _, shape in free_plate_modes(size_mm, band_hz=band_hz)]


def scan_axis_mm(edge_mm: float) -> np.ndarray:
    count = math.floor(edge_mm / 2.0 / 4.5)
    return 4.5 * np.arange(-count, count + 1)


AXIS_MM = scan_axis_mm(137.5)


def mixture(shapes: list[ModeShape], x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Two surfaces as of a real plate: a sum of all modes near one frequency, with either sign."""
    shares = np.random.default_rng(11).uniform(-0.3, 0.3, (2, len(shapes)))
    return np.tensordot(shares, np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes]), axes=1)


def noisy(surfaces: np.ndarray) -> np.ndarray:
    return surfaces + NOISE * np.random.default_rng(1).standard_normal(surfaces.shape)


def map_error(fit: CartographyFit, truth: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray) -> float:
    error = fit.modes.evaluate(grid_points(x_mm, y_mm)).T.reshape(truth.shape) - truth
    return float(np.sqrt((error**2).mean()))


def smoothing_error(size_mm: tuple[float, float], wave_rad_mm: float, surfaces: np.ndarray, truth: np.ndarray) -> float:
    """Error of the fit by the plate equation alone."""
    x_mm, y_mm = (scan_axis_mm(edge_mm) for edge_mm in size_mm)
    basis = PlateBasis((x_mm.size - 1, y_mm.size - 1), (size_mm[0] / 2.0, size_mm[1] / 2.0))
    columns, rows = (axis.ravel() for axis in np.meshgrid(x_mm, y_mm))
    scan = ScatteredData(basis, columns, rows, surfaces.reshape(len(surfaces), -1).T)
    smooth = scan.smooth(plate_equation(basis, wave_rad_mm) + 1e-3 * third_derivatives(basis, wave_rad_mm))
    fine_x_mm, fine_y_mm = (np.linspace(-edge_mm / 2.0, edge_mm / 2.0, truth.shape[-1]) for edge_mm in size_mm)
    error = basis.on_grid(smooth.coefficients, fine_x_mm, fine_y_mm) - truth
    return float(np.sqrt((error**2).mean()))


@pytest.mark.parametrize(
    ("size_mm", "band_hz"), [(SQUARE_MM, (28500.0, 30000.0)), (OBLONG_MM, (22000.0, 23200.0))], ids=["square", "oblong"]
)
def test_a_noisy_mixture_of_free_plate_modes_is_met_with_far_less_error(
    size_mm: tuple[float, float], band_hz: tuple[float, float]
) -> None:
    shapes = neighbours(size_mm, band_hz)
    assert len(shapes) >= 3
    scan = noisy(mixture(shapes, *(scan_axis_mm(edge_mm) for edge_mm in size_mm)))
    fine_mm = [np.linspace(-edge_mm / 2.0, edge_mm / 2.0, 151) for edge_mm in size_mm]
    truth = mixture(shapes, fine_mm[0], fine_mm[1])

    fit = fit_grid(*(scan_axis_mm(edge_mm) for edge_mm in size_mm), scan, size_mm=size_mm)

    assert (fit.freedom < 30.0).all()
    error = map_error(fit, truth, fine_mm[0], fine_mm[1])
    assert error < smoothing_error(size_mm, 2.0 * math.pi / fit.wavelength_mm, scan, truth) / 2.0
    assert error < NOISE / 4.0


def clamped_corner(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """A plate wave with no free edge: oblique, with a point mass near the right edge."""
    x, y = np.meshgrid(x_mm, y_mm)
    wave = np.cos(WAVE_RAD_MM * (0.8 * x + 0.6 * y)) + np.cos(WAVE_RAD_MM * (0.6 * x - 0.8 * y) + 1.0)
    return 0.5 * wave[None] + 0.3 * np.exp(-math.hypot(WAVE_RAD_MM, 0.1) * (68.75 - x)) * np.cos(0.1 * y)


def test_a_plate_that_is_not_free_keeps_the_smoothing_fit() -> None:
    fine_mm = np.linspace(-68.75, 68.75, 151)
    truth = clamped_corner(fine_mm, fine_mm)
    scan = noisy(clamped_corner(AXIS_MM, AXIS_MM))

    fit = fit_grid(AXIS_MM, AXIS_MM, scan)

    assert (fit.freedom > 60.0).all()
    error = map_error(fit, truth, fine_mm, fine_mm)
    assert error < NOISE / 2.0
    assert error == pytest.approx(smoothing_error(SQUARE_MM, 2.0 * math.pi / fit.wavelength_mm, scan, truth), rel=0.02)


# --- pose -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "pose", [Pose(math.radians(5.0), 2.0, -3.0), Pose(math.radians(-2.0), 0.5, 4.0), Pose(0.0, -3.5, -2.0)]
)
def test_some_degrees_and_millimetres_are_found_from_the_scan_alone(pose: Pose) -> None:
    points, readings = sample_scan(driven_modes(), pose=pose, seed=3)

    found = fit_scan(points, readings).pose

    # Noise of 2 % at 961 points: 0.01 mm, and as much at the rim.
    assert found.rotation_rad == pytest.approx(pose.rotation_rad, abs=6e-4)
    assert found[1:] == pytest.approx(pose[1:], abs=0.03)
