"""Where the simulated plate's shapes peak, and its third mode."""

from __future__ import annotations

import numpy as np

from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings


def test_a_third_mode_has_an_amplifier_a_sensor_and_a_place_on_the_map() -> None:
    truth = GroundTruth(PlateSettings(driven_modes=3))

    assert truth.gain_um_per_v_s.shape == truth.sensor.T.shape == (4, 3)
    np.testing.assert_array_equal(np.diag(truth.sensor), 1.0)
    driven = -1j * np.diag(truth.gain_um_per_v_s) * 150.0
    held_um = driven / (1.5 * truth.nominal_decay_1_s - 1j * truth.nominal_detuning_rad_s)
    np.testing.assert_allclose(np.abs(held_um), 4.0)
    assert truth.true_mode_map().M == 3
    assert [len(truth.scan(1, is_driven)[0]) for is_driven in (True, False)] == [3, 1]
