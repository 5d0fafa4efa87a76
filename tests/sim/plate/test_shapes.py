"""Where the simulated plate's shapes peak, and its third mode."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.plate.ground_truth import DRIVEN_MODES, MODES, GroundTruth, PlateSettings
from hapticd.sim.plate.shapes import theory

EDGE_MM = 68.75
REACH_MM = EDGE_MM - 10.0


def largest(half_mm: float) -> np.ndarray:
    axis_mm = np.linspace(-half_mm, half_mm, 401)
    return np.array([np.abs(theory(name)[1].on_grid(axis_mm, axis_mm)).max() for name in MODES])


def test_a_free_plate_peaks_at_its_edges() -> None:
    np.testing.assert_allclose(largest(EDGE_MM), 1.0, atol=1e-3)
    assert 0.6 < largest(REACH_MM)[0] < 0.7


def test_a_third_mode_has_an_amplifier_a_sensor_and_a_place_on_the_map() -> None:
    truth = GroundTruth(PlateSettings(driven_modes=3))

    assert truth.gain_um_per_v_s.shape == truth.sensor.T.shape == (4, 3)
    np.testing.assert_array_equal(np.diag(truth.sensor), 1.0)
    driven = -1j * np.diag(truth.gain_um_per_v_s) * 150.0
    held_um = driven / (1.5 * truth.nominal_decay_1_s - 1j * truth.nominal_detuning_rad_s)
    np.testing.assert_allclose(np.abs(held_um), 4.0)
    assert truth.measured_mode_map(1).M == 3
    assert truth.parasitic_modes(1).modes.M == 1


def test_what_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match=r"driven_modes is 5; give 2 to 4"):
        PlateSettings(driven_modes=5)
    with pytest.raises(ValueError, match="has no mode"):
        theory(DRIVEN_MODES[0] + "0")
