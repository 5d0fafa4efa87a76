"""The fit of scattered points: rotated, shifted, scaled, complex, with gaps and outliers."""

from __future__ import annotations

import cmath
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from hapticd.design import CartographyFit, Pose, fit_scan, sample_scan
from hapticd.errors import ModesError

from .reference_plate import driven_modes, grid_points

pytestmark = pytest.mark.long

NOISE = 0.02
FINE_MM = np.linspace(-68.75, 68.75, 139)
FINE_POINTS = grid_points(FINE_MM, FINE_MM)
SCALE = (740.0 * cmath.exp(1.1j), 0.3 * cmath.exp(-2.5j))
TURNED = Pose(math.radians(3.0), 2.0, -2.0)


@cache
def truth() -> np.ndarray:
    return np.stack([mode.evaluate(FINE_POINTS) for mode in driven_modes()], axis=-1)


def map_errors(fit: CartographyFit, scale: Any = 1.0) -> np.ndarray:
    """RMS over the plate of map minus ground truth, in the scale of the readings, per mode."""
    error = fit.modes.evaluate(FINE_POINTS) * fit.scale / scale - truth()
    return np.sqrt((np.abs(error) ** 2).mean(axis=0))


@pytest.mark.parametrize(
    ("scan", "most"),
    [
        ({"missing_frac": 0.3}, 5.0),
        ({"pose": TURNED}, 5.0),
        ({"scale": SCALE}, 5.0),
        ({"dropout_frac": 0.1}, 5.0),
        ({"missing_frac": 0.2, "dropout_frac": 0.05, "pose": TURNED, "scale": SCALE}, 4.0),
    ],
    ids=["lost points", "turned", "scaled", "drop-outs", "all at once"],
)
def test_the_map_errs_by_a_small_part_of_the_noise(scan: dict[str, Any], most: float) -> None:
    fit = fit_scan(*sample_scan(driven_modes(), seed=4, **scan))
    assert (map_errors(fit, np.array(scan.get("scale", 1.0))) < NOISE / most).all()
    np.testing.assert_allclose(fit.noise_rms, NOISE, rtol=0.1)
    np.testing.assert_allclose(fit.across_rms, NOISE, rtol=0.1)


def test_a_map_of_many_modes_is_coarser_instead_of_refused() -> None:
    fit = fit_scan(*sample_scan(driven_modes() * 13, seed=4), by="plate_equation")
    assert 200_000 < fit.modes.shapes.size <= 250_000
    assert (fit.modes.evaluate(FINE_POINTS)[:, :2] - truth()).std() < NOISE


def test_the_cross_validated_residual_is_what_points_held_back_show() -> None:
    points, readings = sample_scan(driven_modes(), seed=7)
    missed = []
    for fold in range(4):
        held = np.arange(len(points)) % 4 == fold
        fit = fit_scan(points[~held], readings[~held], normalise=False)
        missed.append(readings[held] * np.exp(-1j * np.angle(fit.scale)) - fit.modes.evaluate(points[held]))

    estimated = fit_scan(points, readings, normalise=False).prediction_rms
    # 240 points a fold, each judged by a map made of three quarters of the points.
    np.testing.assert_allclose(np.sqrt((np.concatenate(missed).real ** 2).mean(axis=0)), estimated, rtol=0.05)


POINTS = np.random.default_rng(9).uniform(-60.0, 60.0, (400, 2))
WAVE = np.cos(0.24 * POINTS)


@pytest.mark.parametrize(
    ("points", "readings", "what"),
    [
        (POINTS, WAVE[:399], "a row per point"),
        (POINTS.ravel(), WAVE, "a row per point"),
        (POINTS[:40], WAVE[:40], "too few"),
        (POINTS, WAVE[:, :0], "too few"),
        (np.where(POINTS > 59.0, np.nan, POINTS), WAVE, "not a number"),
        (POINTS + 30.0, WAVE, "off a plate of 137.5 mm"),
        (POINTS, WAVE * 1e13, "absurdly large"),
        (POINTS, np.where(POINTS > 0.0, np.nan, WAVE), "more than half"),
        (POINTS, WAVE * [1.0, 0.0], "mode 2 is zero"),
    ],
)
def test_invalid_scans_are_refused_in_a_sentence(points: np.ndarray, readings: np.ndarray, what: str) -> None:
    with pytest.raises(ModesError, match=rf"{what}.*\.$"):
        fit_scan(points, readings)


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        ({"size_mm": (137.5, 0.0)}, "size_mm"),
        ({"size_mm": (math.nan, 137.5)}, "size_mm"),
        ({"by": "guess"}, "no fit by 'guess'"),
    ],
)
def test_invalid_options_are_refused_in_a_sentence(wrong: dict[str, Any], what: str) -> None:
    with pytest.raises(ValueError, match=rf"{what}.*\.$"):
        fit_scan(POINTS, WAVE, **wrong)
