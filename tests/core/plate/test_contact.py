"""Gram matrices of contacts: seven points against a Gauss quadrature, and what no finger has."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.core.plate.contact import contact_gram, contact_grams, disc_points, stretch
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.score import disc


@pytest.fixture(scope="module")
def modes() -> ModeShapes:
    return GroundTruth(PlateSettings.of("fingertip")).measured_mode_map(1)


def test_seven_points_agree_with_a_quadrature_of_the_disc(modes: ModeShapes) -> None:
    points_mm = np.random.default_rng(1).uniform(-80, 80, (50, 2))
    offsets_mm, weights = disc(5.0)
    phi = modes.evaluate((points_mm[:, None] + offsets_mm).reshape(-1, 2)).reshape(len(points_mm), -1, modes.M)
    exact = np.einsum("nqk,q,nql->nkl", phi, weights, phi)

    assert contact_grams(modes, points_mm, 5.0) == pytest.approx(exact, abs=4e-3)


def test_the_rule_integrates_polynomials_of_degree_five() -> None:
    x_mm, y_mm, weights = np.array(disc_points(3.0)).T
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ x_mm**2 == pytest.approx(3.0**2 / 4)
    assert weights @ (x_mm**2 * y_mm**2) == pytest.approx(3.0**4 / 24)
    assert weights @ x_mm**4 == pytest.approx(3.0**4 / 8)
    for power in (1, 3, 5):
        assert weights @ x_mm**power == pytest.approx(0.0, abs=1e-12)


def test_an_uncertain_disc_is_the_mean_over_the_places_where_it_may_be(modes: ModeShapes) -> None:
    random, sigma_mm = np.random.default_rng(3), 0.8
    places_mm = np.array([12.0, -30.0]) + sigma_mm * random.normal(size=(4000, 2))
    expected = contact_grams(modes, places_mm, 5.0).mean(axis=0)
    stretched = np.array(contact_gram(modes, disc_points(5.0), 12.0, -30.0, stretch(sigma_mm**2, 5.0)))
    certain = np.array(contact_gram(modes, disc_points(5.0), 12.0, -30.0))
    assert np.abs(stretched - expected).max() < 0.3 * np.abs(certain - expected).max()


@pytest.mark.parametrize(("variance_mm2", "by"), [(0.0, 1.0), (math.nan, 1.0), (-1.0, 1.0), (1e300, 1.5)])
def test_a_variance_that_says_nothing_leaves_the_disc_or_bounds_it(variance_mm2: float, by: float) -> None:
    assert stretch(variance_mm2, 5.0) == by


def test_a_disc_of_no_size_is_a_point(modes: ModeShapes) -> None:
    phi = np.array(modes.at(12.0, -30.0))
    assert contact_grams(modes, [(12.0, -30.0)], 0.0)[0] == pytest.approx(np.outer(phi, phi))


def test_a_position_that_is_unknown_moves_nothing(modes: ModeShapes) -> None:
    assert not np.any(contact_gram(modes, disc_points(5.0), float("nan"), 0.0))


def test_points_and_radii_of_another_form_are_refused_in_one_sentence(modes: ModeShapes) -> None:
    with pytest.raises(ValueError, match=r"points_mm has shape \(3,\); give"):
        contact_grams(modes, [1.0, 2.0, 3.0], 5.0)
    with pytest.raises(ValueError, match=r"radius_mm is -1.0; give"):
        contact_grams(modes, [(0.0, 0.0)], -1.0)
