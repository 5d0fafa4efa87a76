"""What a map may lack: its surfaces, and how far each may be from zero."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design.touch.waves import Waves

from .synthetic import WAVE_RAD_MM, mode_map


@pytest.fixture(scope="module")
def waves() -> Waves:
    return Waves(mode_map(), WAVE_RAD_MM)


def test_two_modes_get_two_hundred_surfaces_that_hold_most_of_the_variance(waves: Waves) -> None:
    assert len(waves) == 200
    assert 0.8 < float((waves.prior**2).sum()) <= 1.0
    assert np.all(np.diff(waves.prior) <= 0.0)


def test_a_grid_has_the_values_of_its_points(waves: Waves) -> None:
    coefficients = np.random.default_rng(1).standard_normal((2, len(waves)))
    x_mm, y_mm = np.array((-50.0, 3.0, 40.0)), np.array((-20.0, 60.0))
    grid = waves.on_grid(coefficients, x_mm, y_mm)
    assert grid.shape == (2, 2, 3)
    assert grid[:, 1, 2] == pytest.approx(waves.at(np.array([(40.0, 60.0)]))[0] @ coefficients.T)
