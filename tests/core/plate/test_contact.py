"""Contacts: their Gram matrices against a Gauss quadrature, their growth, and what no finger has."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pipeline_bench import contact_grams

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


def test_an_uncertain_disc_is_the_mean_over_the_places_where_it_may_be(modes: ModeShapes) -> None:
    random, sigma_mm = np.random.default_rng(3), 0.8
    places_mm = np.array([12.0, -30.0]) + sigma_mm * random.normal(size=(20000, 2))
    expected = contact_grams(modes, places_mm, 5.0).mean(axis=0)
    certain, grown = (
        contact_grams(modes, [(12.0, -30.0)], radius_mm)[0] for radius_mm in (5.0, math.hypot(5.0, 2.0 * sigma_mm))
    )
    assert np.abs(grown - expected).max() < 0.4 * np.abs(certain - expected).max()
