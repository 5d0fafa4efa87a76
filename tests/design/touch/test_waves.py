"""What a map may lack: its surfaces, and how far each may be from zero."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design.touch.waves import MAP_PRIOR, PARASITIC_PRIOR, TURNED_PRIOR, Waves

from .synthetic import WAVE_RAD_MM, mode_map

BOX_MM = np.linspace(22.0, 58.0, 9)


@pytest.fixture(scope="module")
def waves() -> Waves:
    return Waves(mode_map(), WAVE_RAD_MM)


def test_two_modes_get_three_hundred_smooth_surfaces_that_hold_most_of_the_variance(waves: Waves) -> None:
    smooth = waves.prior[:, : waves.smooth]
    assert waves.smooth == 300
    assert 0.8 < float((smooth[0] ** 2).sum()) / MAP_PRIOR**2 <= 1.0
    assert np.all(np.diff(smooth) <= 0.0)


def test_modes_may_have_turned_into_each_other_and_into_those_beside_them(waves: Waves) -> None:
    turned = Waves(mode_map(), WAVE_RAD_MM, mode_map())
    assert (len(waves), len(turned)) == (302, 304)
    assert turned.prior[0, 301] == turned.prior[1, 300] == TURNED_PRIOR
    assert np.all(turned.prior[:, 302:] == PARASITIC_PRIOR)
    coefficients = np.zeros((2, len(turned)))
    coefficients[0, 301], coefficients[1, 302] = 0.1, -0.02
    points = np.array([(40.0, 60.0), (-3.0, 11.0)])
    shapes = mode_map().evaluate(points)
    expected = np.stack((0.1 * shapes[:, 1], -0.02 * shapes[:, 0]), axis=-1)
    assert turned.at(points) @ coefficients.T == pytest.approx(expected)


def test_a_change_of_form_stays_and_the_map_keeps_its_scale(waves: Waves) -> None:
    modes = mode_map()
    coefficients = np.zeros((2, len(waves)))
    coefficients[0, 300] = coefficients[1, 301] = 0.05  # which loads pass for
    assert waves.of_scale(coefficients) == pytest.approx(0.0, abs=1e-12)
    coefficients = np.random.default_rng(2).normal(0.0, 0.02, (2, len(waves))) * (waves.prior > 1e-3)
    coefficients[0, 300] += 0.03
    before, after = (
        modes.shapes + waves.on_grid(one, modes.x_mm, modes.y_mm)
        for one in (coefficients, waves.of_scale(coefficients))
    )
    assert np.vdot(modes.shapes, after) == pytest.approx(np.vdot(modes.shapes, modes.shapes))
    assert after / after[0, 40, 40] == pytest.approx(before / before[0, 40, 40])


def test_grid_has_the_values_of_its_points_and_a_change_its_rms(waves: Waves) -> None:
    coefficients = np.random.default_rng(1).standard_normal((2, len(waves)))
    x_mm, y_mm = np.array((-50.0, 3.0, 40.0)), np.array((-20.0, 60.0))
    grid = waves.on_grid(coefficients, x_mm, y_mm)
    assert grid.shape == (2, 2, 3)
    assert grid[:, 1, 2] == pytest.approx(waves.at(np.array([(40.0, 60.0)]))[0] @ coefficients.T)
    one = np.zeros((2, len(waves)))
    one[1, 3] = -0.02
    assert waves.rms(one) == pytest.approx((0.0, 0.02), rel=1e-6)


def test_surfaces_of_a_touched_box_are_finer_there_and_fade_away_from_it(waves: Waves) -> None:
    near = Waves(mode_map(), WAVE_RAD_MM, touched_mm=np.array(((20.0, 20.0), (60.0, 60.0))))
    inside, far = (np.stack(np.meshgrid(each, each), axis=-1).reshape(-1, 2) for each in (BOX_MM, -BOX_MM))
    variance = [one.at(inside)[:, : one.smooth] ** 2 @ one.prior[0, : one.smooth] ** 2 for one in (near, waves)]
    assert variance[0].mean() > 1.02 * variance[1].mean()  # of the prior's
    assert variance[0].max() < 1.1 * MAP_PRIOR**2
    assert (near.at(far)[:, : near.smooth] ** 2 @ near.prior[0, : near.smooth] ** 2).max() < 0.5 * MAP_PRIOR**2
