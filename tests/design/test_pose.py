"""How a scan lies on the plate: found to a hundredth of a millimetre, and not invented where it lies straight."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from hapticd.design import ModeShape, Pose, fit_scan, free_plate_modes, sample_scan
from hapticd.design.free_fit import FreePlateModes
from hapticd.design.pose import NOMINAL, find_pose

SIZE_MM = (137.5, 137.5)
WAVE_RAD_MM = 2.0 * math.pi / 26.2


@cache
def driven_modes() -> list[ModeShape]:
    by_name = {shape.name: shape for _, shape in free_plate_modes()}
    return [by_name["11x0"], by_name["0x11"]]


def test_a_pose_turns_about_the_plate_s_centre_and_then_shifts() -> None:
    moved = Pose(math.pi / 2.0, 1.0, -2.0).on_plate(np.array([[10.0, 0.0], [0.0, 5.0], [0.0, 0.0]]))

    np.testing.assert_allclose(moved, [[1.0, 8.0], [-4.0, -2.0], [1.0, -2.0]], atol=1e-12)
    np.testing.assert_array_equal(NOMINAL.on_plate(moved), moved)


@pytest.mark.parametrize(
    "pose", [Pose(math.radians(5.0), 2.0, -3.0), Pose(math.radians(-2.0), 0.5, 4.0), Pose(0.0, -3.5, -2.0)]
)
def test_some_degrees_and_millimetres_are_found_from_the_scan_alone(pose: Pose) -> None:
    points, readings = sample_scan(driven_modes(), pose=pose, seed=3)

    found = fit_scan(points, readings).pose

    # Noise of 2 % at 961 points: 0.01 mm, and as much at the rim.
    assert found.rotation_rad == pytest.approx(pose.rotation_rad, abs=6e-4)
    assert found[1:] == pytest.approx(pose[1:], abs=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_a_straight_scan_is_left_as_it_lies(seed: int) -> None:
    points, readings = sample_scan(driven_modes(), seed=seed, missing_frac=0.6)
    modes = FreePlateModes(SIZE_MM, WAVE_RAD_MM)

    _, pose = modes.fit(points, readings.real)

    assert pose == NOMINAL


def test_without_noise_the_pose_is_exact() -> None:
    pose = Pose(math.radians(3.0), 1.25, -0.75)
    points, readings = sample_scan(driven_modes(), pose=pose, noise_frac=0.0)

    found = find_pose(FreePlateModes(SIZE_MM, WAVE_RAD_MM).at, points, readings.real)

    assert found == pytest.approx(pose, abs=1e-7)


def test_a_slope_of_the_basis_is_the_difference_of_its_values() -> None:
    modes = FreePlateModes(SIZE_MM, WAVE_RAD_MM)
    points = np.random.default_rng(1).uniform(-68.0, 68.0, (30, 2))
    step_mm = 1e-4

    for axis, order in enumerate(((1, 0), (0, 1))):
        shift = np.eye(2)[axis] * step_mm
        slope = (modes.at(points + shift) - modes.at(points - shift)) / (2.0 * step_mm)
        np.testing.assert_allclose(modes.at(points, order), slope, rtol=0.0, atol=1e-7)
