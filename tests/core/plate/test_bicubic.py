"""Bicubic surfaces against polynomials, scipy and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from hapticd.core.plate.bicubic import BicubicSurfaces, fill_gaps


def uneven_knots(random: np.random.Generator, count: int) -> np.ndarray:
    return np.cumsum(random.uniform(0.5, 1.5, count)) - count / 2.0


def random_surfaces(seed: int) -> tuple[BicubicSurfaces, np.ndarray, np.random.Generator]:
    random = np.random.default_rng(seed)
    x, y = uneven_knots(random, 9), uneven_knots(random, 7)
    values = random.standard_normal((3, 7, 9))
    return BicubicSurfaces(x, y, values), values, random


def points_within(random: np.random.Generator, surfaces: BicubicSurfaces, count: int) -> np.ndarray:
    x = random.uniform(surfaces.x_knots[0], surfaces.x_knots[-1], count)
    y = random.uniform(surfaces.y_knots[0], surfaces.y_knots[-1], count)
    return np.stack((x, y), axis=-1)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(4, 12), st.integers(4, 12))
def test_a_bicubic_polynomial_is_reproduced_on_any_grid(seed: int, nx: int, ny: int) -> None:
    random = np.random.default_rng(seed)
    x, y = uneven_knots(random, nx), uneven_knots(random, ny)
    coefficients = random.standard_normal((4, 4))
    surfaces = BicubicSurfaces(x, y, np.polynomial.polynomial.polygrid2d(x, y, coefficients).T[None])
    points = points_within(random, surfaces, 50)

    expected = np.polynomial.polynomial.polyval2d(points[:, 0], points[:, 1], coefficients)
    scale = np.abs(np.polynomial.polynomial.polygrid2d(x, y, coefficients)).max()

    np.testing.assert_allclose(surfaces.evaluate(points)[:, 0], expected, rtol=0.0, atol=1e-10 * scale)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_not_a_knot_spline_of_scipy(seed: int) -> None:
    surfaces, values, random = random_surfaces(seed)
    points = points_within(random, surfaces, 200)

    along_y = make_interp_spline(surfaces.y_knots, values, k=3, axis=1)(points[:, 1])
    expected = [
        [make_interp_spline(surfaces.x_knots, along_y[m, n], k=3)(points[n, 0]) for m in range(3)] for n in range(200)
    ]

    np.testing.assert_allclose(surfaces.evaluate(points), expected, rtol=0.0, atol=1e-11)


def test_the_grid_s_own_values_are_reproduced() -> None:
    surfaces, values, _ = random_surfaces(5)
    grid = np.stack(np.meshgrid(surfaces.x_knots, surfaces.y_knots), axis=-1).reshape(-1, 2)

    np.testing.assert_allclose(surfaces.evaluate(grid).T.reshape(values.shape), values, rtol=0.0, atol=1e-12)


def test_the_gradient_is_the_slope_of_the_value() -> None:
    surfaces, _, random = random_surfaces(6)
    points = points_within(random, surfaces, 300) * 0.99
    step = 1e-5

    for axis in (0, 1):
        shift = np.eye(2)[axis] * step
        slope = (surfaces.evaluate(points + shift) - surfaces.evaluate(points - shift)) / (2.0 * step)
        np.testing.assert_allclose(surfaces.gradient(points)[..., axis], slope, rtol=0.0, atol=1e-8)


def test_slope_and_curvature_do_not_jump_between_cells() -> None:
    surfaces, _, random = random_surfaces(7)
    y = random.uniform(surfaces.y_knots[0], surfaces.y_knots[-1], 20)
    step = 1e-4

    for knot in surfaces.x_knots[1:-1]:
        at = [np.stack((np.full(20, knot + k * step), y), axis=-1) for k in (-2, -1, -1e-9, 1e-9, 1, 2)]
        far_left, left, just_left, just_right, right, far_right = (surfaces.gradient(points)[..., 0] for points in at)
        np.testing.assert_allclose(just_left, just_right, rtol=0.0, atol=1e-6)
        # One-sided second derivatives, each exact for the cubic on its side of the knot to first order in the step.
        before, after = (3 * just_left - 4 * left + far_left), (-3 * just_right + 4 * right - far_right)
        np.testing.assert_allclose(before, after, rtol=0.0, atol=2e-3 * 2 * step)


def test_beyond_the_edge_the_surface_is_constant() -> None:
    surfaces, _, _ = random_surfaces(8)
    corner = np.array([[surfaces.x_knots[-1], surfaces.y_knots[0]]])
    beyond = np.array([[np.inf, -1e9]])

    np.testing.assert_array_equal(surfaces.evaluate(beyond), surfaces.evaluate(corner))
    np.testing.assert_array_equal(surfaces.gradient(beyond), np.zeros((1, 3, 2)))
    outside = np.array([[surfaces.x_knots[-1] + 1.0, 0.3]])
    on_edge = np.array([[surfaces.x_knots[-1], 0.3]])
    np.testing.assert_array_equal(surfaces.gradient(outside)[..., 1], surfaces.gradient(on_edge)[..., 1])
    np.testing.assert_array_equal(surfaces.gradient(outside)[..., 0], np.zeros((1, 3)))


def test_an_unknown_position_gives_zeros_and_changes_no_other_point() -> None:
    surfaces, _, random = random_surfaces(9)
    points = points_within(random, surfaces, 4)
    alone = surfaces.evaluate(points[[0, 3]])
    points[1, 0] = points[2, 1] = np.nan

    np.testing.assert_array_equal(surfaces.evaluate(points)[1:3], np.zeros((2, 3)))
    np.testing.assert_array_equal(surfaces.gradient(points)[1:3], np.zeros((2, 3, 2)))
    np.testing.assert_array_equal(surfaces.evaluate(points)[[0, 3]], alone)


def test_a_gap_in_a_wave_is_filled_and_measured_points_stay() -> None:
    position = 4.5 * np.arange(-15, 16)
    wave = np.cos(2.0 * np.pi * position[None, :] / 27.0 + 0.3) * np.cos(2.0 * np.pi * position[:, None] / 60.0)
    holed = wave.copy()
    random = np.random.default_rng(1)
    inner = random.integers(4, 27, (12, 2))
    holed[inner[:, 0], inner[:, 1]] = np.nan

    filled = fill_gaps(position, position, np.stack((holed, wave)))

    known = ~np.isnan(holed)
    np.testing.assert_array_equal(filled[0][known], wave[known])
    np.testing.assert_array_equal(filled[1], wave)
    assert np.abs(filled[0] - wave).max() < 0.02


@pytest.mark.parametrize("nx", [4, 5, 9])
def test_a_gap_in_a_slope_is_filled_exactly_even_on_the_smallest_uneven_grid(nx: int) -> None:
    random = np.random.default_rng(nx)
    x, y = uneven_knots(random, nx), uneven_knots(random, 6)
    slope = 2.0 * x[None, :] - 3.0 * y[:, None] + 1.0
    holed = slope.copy()
    holed[2, 1] = np.nan

    np.testing.assert_allclose(fill_gaps(x, y, holed[None])[0], slope, rtol=0.0, atol=1e-8)


def test_a_gap_too_wide_for_the_smallest_grid_is_still_filled_with_numbers() -> None:
    knots = np.arange(4.0)
    holed = np.ones((1, 4, 4))
    holed[0, 1:3, 1:3] = np.nan

    assert np.isfinite(fill_gaps(knots, knots, holed)).all()
