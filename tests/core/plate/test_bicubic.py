"""Bicubic surfaces against polynomials, scipy and finite differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from hapticd.core.plate.bicubic import POINT, BicubicSurfaces, fill_gaps
from hapticd.core.plate.splines import evaluate, perceive


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


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_not_a_knot_spline_of_scipy(seed: int) -> None:
    surfaces, values, random = random_surfaces(seed)
    points = points_within(random, surfaces, 200)

    along_y = make_interp_spline(surfaces.y_knots, values, k=3, axis=1)(points[:, 1])
    expected = [
        [make_interp_spline(surfaces.x_knots, along_y[m, n], k=3)(points[n, 0]) for m in range(3)] for n in range(200)
    ]

    np.testing.assert_allclose(surfaces.evaluate(points), expected, rtol=0.0, atol=1e-11)


def test_slopes_equal_finite_differences_and_contacts_are_points_round_centres() -> None:
    surfaces, _, random = random_surfaces(4)
    points, step = 0.9 * points_within(random, surfaces, 50), 1e-5
    for axis in (0, 1):
        away = step * np.eye(2)[axis]
        slopes = (surfaces.evaluate(points + away) - surfaces.evaluate(points - away)) / (2.0 * step)
        np.testing.assert_allclose(surfaces.gradient(points)[..., axis], slopes, rtol=0.0, atol=1e-5)

    disc, (xx, xy, yy) = np.array([(0.3, -0.2, 0.5), (-1.0, 0.4, 0.5)]), (1.5, 0.2, 0.7)
    around = (points[:, None] + disc[:, :2] @ np.array([(xx, xy), (xy, yy)])).reshape(-1, 2)
    ellipses = [(xx, xy, yy)] * 49 + [None]
    found = np.frombuffer(evaluate(surfaces.tables, disc, points.tolist(), ellipses, 0.0, False)).reshape(-1, 3)
    np.testing.assert_allclose(found[:-2], surfaces.evaluate(around)[:-2], rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(found[-2:], surfaces.evaluate(points[[-1, -1]]))


def test_tables_of_another_form_are_refused() -> None:
    (patches, x, y), place = (tables := random_surfaces(5)[0].tables), [(0.0, 0.0)]
    given: list[tuple[Any, ...]] = [((patches, x, x), place, None), ((patches, x[:1], y), place, None)]
    given += [(tables, [(0.0,)], None), (tables, place, []), (tables, place, [(5.0,)]), (tables, [7], None)]
    given += [(None, place, None), (tables, [("x", 0.0)], None)]
    for wrong, places, ellipses in given:
        with pytest.raises((ValueError, TypeError), match=r"lengths|None|real number"):
            evaluate(wrong, POINT, places, ellipses, 5.0, False)
    for modal_um, curve in ((0j,) * 4, np.zeros(5)), ((0j,) * 3, np.zeros(4)), ((0j,) * 99, np.zeros(5)):
        with pytest.raises(ValueError, match="lengths"):
            perceive(tables, POINT, (0.0, 0.0, 5.0, 0.0, 5.0), modal_um, curve, 1.0, 0.0, 0.0)


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
