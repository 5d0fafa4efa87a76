"""Where the simulated plate's shapes peak, and what a plate of other shapes keeps."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.plate import shapes as plate_shapes
from hapticd.sim.plate.ground_truth import DRIVEN_MODES, MODES, GroundTruth, PlateSettings

EDGE_MM = 68.75
REACH_MM = EDGE_MM - plate_shapes.BEYOND_REACH_MM


def largest(kind: str, half_mm: float) -> np.ndarray:
    axis_mm = np.linspace(-half_mm, half_mm, 401)
    shapes = plate_shapes.shapes(kind, MODES)
    return np.array([np.abs(shape.on_grid(axis_mm, axis_mm)).max() for shape in shapes])


def test_a_free_plate_peaks_at_its_edges_and_the_other_scale_where_fingers_are() -> None:
    free, scaled = plate_shapes.FREE_PLATE, plate_shapes.PEAK_AT_FINGERS
    np.testing.assert_allclose(largest(free, EDGE_MM), 1.0, atol=1e-3)
    assert 0.6 < largest(free, REACH_MM)[0] < 0.7
    np.testing.assert_allclose(largest(scaled, REACH_MM)[:2], 1.0, atol=1e-3)
    assert (largest(scaled, EDGE_MM) > 1.4).all()


def test_cosines_are_standing_waves_of_the_paper_s_length() -> None:
    points_mm = np.random.default_rng(1).uniform(-EDGE_MM, EDGE_MM, (500, 2))
    x, y, third = plate_shapes.shapes(plate_shapes.COSINES, MODES[:3])
    wave_rad_mm = 2.0 * np.pi / plate_shapes.WAVELENGTH_MM
    along, across = wave_rad_mm * np.array([9.0, 6.0]) / np.hypot(9.0, 6.0)

    np.testing.assert_allclose(x.evaluate(points_mm), np.cos(wave_rad_mm * points_mm[:, 0]), atol=1e-9)
    np.testing.assert_allclose(y.evaluate(points_mm), np.cos(wave_rad_mm * points_mm[:, 1]), atol=1e-9)
    product = np.cos(along * points_mm[:, 0]) * np.cos(across * points_mm[:, 1])
    np.testing.assert_allclose(third.evaluate(points_mm), product, atol=1e-9)


def test_other_units_are_of_the_same_plate_so_a_finger_damps_it_as_much() -> None:
    free, scaled = GroundTruth(), GroundTruth(PlateSettings(shapes=plate_shapes.PEAK_AT_FINGERS))
    points_mm = np.random.default_rng(2).uniform(-REACH_MM, REACH_MM, (50, 2))

    added = [truth.finger_decay_1_s * truth.shapes(points_mm) ** 2 for truth in (free, scaled)]
    np.testing.assert_allclose(added[1], added[0], rtol=1e-9)


@pytest.mark.parametrize("kind", plate_shapes.KINDS)
def test_a_third_mode_has_an_amplifier_a_sensor_and_a_place_on_the_map(kind: str) -> None:
    truth = GroundTruth(PlateSettings(shapes=kind, driven_modes=3))

    assert truth.gain_um_per_v_s.shape == truth.sensor.T.shape == (4, 3)
    np.testing.assert_array_equal(np.diag(truth.sensor), 1.0)
    driven = -1j * np.diag(truth.gain_um_per_v_s) * 150.0
    held_um = driven / (1.5 * truth.nominal_decay_1_s - 1j * truth.nominal_detuning_rad_s)
    np.testing.assert_allclose(np.abs(held_um), 4.0)
    assert truth.measured_mode_map(1).M == 3
    assert truth.parasitic_modes(1).modes.M == 1


def test_what_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match=r"shapes is .sines.; choose from free plate"):
        PlateSettings(shapes="sines")
    with pytest.raises(ValueError, match=r"driven_modes is 5; give 2 to 4"):
        PlateSettings(driven_modes=5)
    with pytest.raises(ValueError, match="has no mode"):
        plate_shapes.theory(DRIVEN_MODES[0] + "0")
