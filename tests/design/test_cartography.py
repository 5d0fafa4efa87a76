"""The fit of a scan on a grid against its ground truth, on the whole plate and in the margin."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from hapticd.design import CartographyFit, sample_cartography
from hapticd.errors import ModesError

from .reference_plate import driven_modes, fit_grid, grid_points

pytestmark = pytest.mark.long

FINE_MM = np.linspace(-68.75, 68.75, 276)
FINE_POINTS = grid_points(FINE_MM, FINE_MM)
SCAN_MM = 4.5 * np.arange(-15, 16)
MARGIN = np.maximum(*np.abs(np.meshgrid(FINE_MM, FINE_MM))) > 67.5


@cache
def truth() -> np.ndarray:
    return np.stack([mode.on_grid(FINE_MM, FINE_MM) for mode in driven_modes()])


@cache
def reference_fit(seed: int) -> CartographyFit:
    return fit_grid(*sample_cartography(driven_modes(), seed=seed))


def on_fine_grid(fit: CartographyFit) -> np.ndarray:
    return fit.modes.evaluate(FINE_POINTS).T.reshape(-1, FINE_MM.size, FINE_MM.size)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_map_errs_by_less_than_a_sixth_of_the_scan_s_noise(seed: int) -> None:
    for error in on_fine_grid(reference_fit(seed)) - truth():
        assert rms(error) < 0.020 / 6  # over the whole plate; the noise is 0.020
        assert rms(error[~MARGIN]) < 0.0032
        assert rms(error[MARGIN]) < 0.0061  # where there is no measurement at all
        assert np.abs(error).max() < 0.03


def test_the_fit_estimates_its_noise_its_error_and_the_wavelength() -> None:
    fits = [reference_fit(seed) for seed in (1, 2, 3)]
    errors = np.stack([on_fine_grid(fit) - truth() for fit in fits])

    estimated = np.sqrt(np.mean([fit.map_error_rms**2 for fit in fits]))
    assert estimated == pytest.approx(rms(errors), rel=0.2)  # six surfaces of 15 parameters: good to a tenth
    for fit in fits:
        np.testing.assert_allclose(fit.noise_rms, 0.02, rtol=0.1)
        assert (fit.residual_rms < fit.noise_rms).all()
        assert (fit.noise_rms < fit.prediction_rms).all()
        assert (fit.freedom == 15.0).all()  # free-plate modes whose frequency is within 8 % of X and Y
        assert fit.wavelength_mm == pytest.approx(26.2, rel=0.01)


def test_a_shape_that_is_no_free_plate_mode_is_fitted_as_well() -> None:
    # Waves of one length in random directions, and an evanescent one at the right edge: impossible with free edges.
    random = np.random.default_rng(4)
    direction, phase = random.uniform(0.0, 2.0 * math.pi, (2, 12))
    wave_rad_mm = 2.0 * math.pi / 27.0

    def shape(axis_mm: np.ndarray) -> np.ndarray:
        x, y = np.meshgrid(axis_mm, axis_mm)
        along = x[..., None] * np.cos(direction) + y[..., None] * np.sin(direction)
        waves = np.cos(wave_rad_mm * along + phase).sum(axis=-1)
        evanescent_rad_mm = math.hypot(wave_rad_mm, 0.1)
        return (waves + 3.0 * np.exp(-evanescent_rad_mm * (68.75 - x)) * np.cos(0.1 * y)) / 8.0

    scan = shape(SCAN_MM) + 0.02 * random.standard_normal((31, 31))
    fit = fit_grid(SCAN_MM, SCAN_MM, scan[None])

    assert rms(on_fine_grid(fit)[0] - shape(FINE_MM)) < 0.010
    assert fit.wavelength_mm == pytest.approx(27.0, rel=0.01)


def test_where_the_plate_equation_does_not_hold_the_map_is_no_worse_than_the_scan() -> None:
    # Two wavelengths at once, which violate the plate equation: its weight must fall.
    x, y = np.meshgrid(SCAN_MM, SCAN_MM)
    odd = np.cos(0.24 * x + 0.3) + np.cos(0.10 * y)
    noise = 0.02 * np.random.default_rng(5).standard_normal(odd.shape)
    fit = fit_grid(SCAN_MM, SCAN_MM, (odd + noise)[None])

    x, y = np.meshgrid(FINE_MM, FINE_MM)
    assert rms(on_fine_grid(fit)[0] - np.cos(0.24 * x + 0.3) - np.cos(0.10 * y)) < 0.020


def test_a_scan_without_a_plate_wave_is_refused() -> None:
    with pytest.raises(ModesError, match=r"no plate wave.*\.$"):
        fit_grid(SCAN_MM, SCAN_MM, np.ones((1, 31, 31)) + 0.01 * SCAN_MM**2)


def coarse(step_mm: float, noise_frac: float) -> CartographyFit:
    scan = sample_cartography(driven_modes(), step_mm=step_mm, noise_frac=noise_frac, seed=1)
    return fit_grid(*scan)


@pytest.mark.parametrize("step_mm", [10.0, 10.5, 12.0])
def test_a_grid_too_coarse_for_the_wave_is_refused_with_the_spacing_that_would_do(step_mm: float) -> None:
    with pytest.raises(ModesError, match=r"too far for a wave of 2\d mm; measure at most 8\.\d mm apart\.$"):
        coarse(step_mm, 0.02)
