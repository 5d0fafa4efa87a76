"""The simulated plate's truth: its modes, its limits, and what of it the daemon may see."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design import free_plate_modes
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings


@pytest.fixture(scope="module")
def truth() -> GroundTruth:
    return GroundTruth()


def steady_um(truth: GroundTruth, voltage_v: tuple[complex, complex]) -> np.ndarray:
    """Where dW/dt = (-decay + j detuning) W - j gain V comes to rest, with 1.5 times the plate's own decay."""
    drive = -1j * truth.gain_um_per_v_s @ np.array(voltage_v)
    return drive / (1.5 * truth.decay_1_s - 1j * truth.detuning_rad_s)


@pytest.mark.parametrize("q_factor", [200.0, 500.0, 1000.0])
def test_the_full_voltage_just_holds_the_limit_with_fingers_on_the_plate(q_factor: float) -> None:
    truth = GroundTruth(PlateSettings(q_factor=q_factor))

    assert abs(steady_um(truth, (150.0, 0.0))[0]) == pytest.approx(4.0, rel=1e-12)
    assert abs(steady_um(truth, (0.0, 150.0j))[1]) == pytest.approx(4.0, rel=1e-12)


def test_the_neighbours_of_the_measured_pair_are_the_theory_s(truth: GroundTruth) -> None:
    by_name = {shape.name: (hz, shape) for hz, shape in free_plate_modes()}
    points = np.random.default_rng(1).uniform(-68.75, 68.75, (3000, 2))
    expected = np.stack([by_name[name][1].evaluate(points) for name in ("9x6", "6x9")], axis=-1)
    np.testing.assert_allclose(truth.shapes(points)[:, 2:], expected, rtol=0.0, atol=1e-4)
    share = by_name["9x6"][0] / by_name["11x0"][0]
    assert truth.frequency_hz.tolist() == pytest.approx([29195.0, 29215.0, 29195.0 * share, 29215.0 * share])


def test_a_third_mode_has_an_amplifier_a_sensor_and_a_place_on_the_map() -> None:
    truth = GroundTruth(PlateSettings(driven_modes=3))

    assert truth.gain_um_per_v_s.shape == truth.sensor.T.shape == (4, 3)
    np.testing.assert_array_equal(np.diag(truth.sensor), 1.0)
    driven = -1j * np.diag(truth.gain_um_per_v_s) * 150.0
    held_um = driven / (1.5 * truth.nominal_decay_1_s - 1j * truth.nominal_detuning_rad_s)
    np.testing.assert_allclose(np.abs(held_um), 4.0)
    assert truth.true_mode_map().M == 3
    assert [len(truth.scan(1, is_driven)[0]) for is_driven in (True, False)] == [3, 1]
