"""Errors of laboratories that no calibration models: centroids, warped pads, changed plates, contacts, people."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hapticd.sim import lockstep
from hapticd.sim.fingers.centroids import CentroidPath, warp
from hapticd.sim.fingers.pad_ellipse import USUAL
from hapticd.sim.fingers.paths import Rest
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import Run
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.settings import Settings, in_world
from hapticd.sim.world_causes import played_actors, sensed_paths, sensor_settings
from hapticd.sim.world_errors import CentroidErrors, ContactSizes, EllipseErrors, FingerLoad, WorldErrors
from hapticd.sim.world_tolerances import TOLERANCES, draw

T_S = np.arange(0.0, 60.0, 0.05)
HERE_MM = (10.0, -5.0)
POSE_X_MM, MISTUNING_HZ = -0.20278642607738268, 1.0360103283452204  # before these kinds were added


def off_mm(world: WorldErrors, finger: int = 0, session: int = 0) -> np.ndarray:
    """Where a resting finger is sensed, relative to its place (T, 2)."""
    return CentroidPath(Rest(HERE_MM), world, finger, session).position_mm(T_S) - HERE_MM


def changed(world: WorldErrors) -> tuple[GroundTruth, GroundTruth]:
    """The plate with four driven modes as it was, and as it is."""
    usual = PlateSettings.of("fingertip")
    return GroundTruth(usual), GroundTruth(replace(usual, world=world))


def played(world: WorldErrors, session: int = 0) -> Run:
    settings = in_world(Settings(session=session), world)
    return lockstep.run("strokes", settings=settings, seconds=0.7)


def test_what_was_drawn_before_is_drawn_again() -> None:
    world = draw("laboratory", 7)
    assert world.pad_pose.x_mm == pytest.approx(POSE_X_MM, abs=1e-12)
    assert world.mistuning_hz == pytest.approx(MISTUNING_HZ, abs=1e-12)
    assert list(TOLERANCES).index("stop_ramp") == 21


def test_each_finger_has_a_bias_of_its_own_which_another_session_has_too() -> None:
    world = WorldErrors(centroids=CentroidErrors(finger_mm=0.35), seed=2)
    first, second = off_mm(world)[0], off_mm(world, finger=1)[0]
    assert math.hypot(*first) == pytest.approx(0.35)
    assert math.hypot(*second) == pytest.approx(0.35)
    assert not np.allclose(first, second)
    assert np.allclose(off_mm(world, session=1), first)


def test_a_posture_is_that_of_all_fingers_and_another_session_has_another() -> None:
    world = WorldErrors(centroids=CentroidErrors(posture_mm=0.3), seed=2)
    assert np.allclose(off_mm(world, finger=1), off_mm(world)[0])
    assert not np.allclose(off_mm(world, session=1), off_mm(world)[0])


def test_a_finger_that_rolls_wanders_and_one_that_presses_shifts_with_its_force() -> None:
    wandering = off_mm(WorldErrors(centroids=CentroidErrors(wander_mm=0.5), seed=2))
    assert math.sqrt(np.mean(np.sum(wandering**2, axis=1))) == pytest.approx(0.5, rel=0.25)
    load = FingerLoad(force_frac=0.4)
    pressed = off_mm(WorldErrors(centroids=CentroidErrors(pressure_mm=1.0), finger_load=load, seed=2))
    along_mm = pressed @ (pressed[0] / math.hypot(*pressed[0]))
    assert np.abs(along_mm).max() == pytest.approx(0.4, rel=0.05)
    assert np.allclose(np.abs(along_mm), np.abs(load.force(2, 0, T_S) - 1.0))


def test_a_warped_pad_is_off_by_as_much_as_is_said_at_most_and_nowhere_alike() -> None:
    axis_mm = np.linspace(-60.0, 60.0, 41)
    grid_mm = np.stack(np.meshgrid(axis_mm, axis_mm), axis=-1).reshape(-1, 2)
    lengths = np.hypot(*warp(grid_mm, 5).T)
    assert lengths.max() == pytest.approx(1.0)
    assert lengths.min() < 0.5
    still = sensed_paths([Rest(HERE_MM)], WorldErrors(pad_warp_mm=0.5, seed=5))[0].position_mm(T_S)
    assert np.ptp(still, axis=0).max() < 1e-12
    assert 0.0 < math.dist(still[0], HERE_MM) <= 0.5


def test_a_lost_corner_and_springs_raise_and_mix_modes_and_no_scan_shows_it() -> None:
    for world in (WorldErrors(chip_mm=2.0, seed=3), WorldErrors(supports_hz=5.0, seed=3)):
        before, after = changed(world)
        risen_hz = after.frequency_hz - before.frequency_hz
        assert (risen_hz > -1e-6).all()
        assert 0.5 < risen_hz.max() < 40.0
        shapes = [plate.shapes(np.array([(50.0, 30.0), (-20.0, 70.0)])) for plate in (before, after)]
        assert 1e-3 < np.abs(shapes[1] - shapes[0]).max() < 0.5
        assert np.array_equal(after.measured_mode_map(1).shapes, before.measured_mode_map(1).shapes)
        assert after.nominal_detuning_rad_s.tolist() == before.nominal_detuning_rad_s.tolist()


def test_mixed_modes_are_turned_into_each_other_by_the_angle() -> None:
    before, after = changed(WorldErrors(mixing_deg=5.0, seed=3))
    points_mm = np.random.default_rng(1).uniform(-90.0, 90.0, (40, 2))
    turned, _, _, _ = np.linalg.lstsq(before.shapes(points_mm), after.shapes(points_mm), rcond=None)
    assert np.allclose(turned.diagonal()[:8], math.cos(math.radians(5.0)), atol=1e-3)
    assert abs(turned[0, 1]) == pytest.approx(math.sin(math.radians(5.0)), abs=1e-3)
    assert np.allclose(after.frequency_hz, before.frequency_hz)


def test_a_plate_that_warms_up_drifts_by_so_many_hertz_a_minute_and_the_loop_notices() -> None:
    world = WorldErrors(drift_hz_per_min=5.0)
    plate = GroundTruth(PlateSettings(world=world))
    assert np.allclose(plate.drifted_rad_s(60.0) - plate.detuning_rad_s, 2.0 * math.pi * 5.0)
    assert not np.array_equal(played(world).plate_um, played(WorldErrors()).plate_um)


def test_contacts_differ_from_finger_to_finger_within_their_bounds() -> None:
    actors = SCENARIOS["two-of-five"].build(1, 100.0)
    world = WorldErrors(contacts=ContactSizes(4.0, 7.0, 1.4), seed=3)
    tips = [actor.fingertip for actor in played_actors(actors, world)]
    for tip in tips:
        assert tip is not None
        assert 4.0 <= math.sqrt(tip.major_mm * tip.minor_mm) <= 7.0
        assert 1.0 <= tip.major_mm / tip.minor_mm <= 1.4
    assert len(set(tips)) == len(tips)


def test_a_finger_loads_the_plate_over_its_contact_or_without_size_at_its_centre() -> None:
    centre, hardly, whole = (
        played(WorldErrors(finger_load=FingerLoad(spread_frac=frac), seed=1)).plate_um for frac in (0.0, 1e-6, 1.0)
    )
    assert np.allclose(hardly, centre, atol=1e-6)
    assert not np.allclose(whole, centre, atol=1e-3)


def test_a_pad_reports_ellipses_by_a_law_of_its_own() -> None:
    ellipse = sensor_settings(WorldErrors(ellipses=EllipseErrors(0.1, -0.5))).ellipse
    assert ellipse.scale == pytest.approx(1.1 * USUAL.scale)
    assert ellipse.offset_mm == pytest.approx(USUAL.offset_mm - 0.5)
    assert sensor_settings(WorldErrors()).ellipse == USUAL


def test_another_person_feels_something_else_on_the_same_plate() -> None:
    # Worlds other than the ideal one, in which sensors are known better and references larger.
    usual, other = played(WorldErrors(seed=1)), played(WorldErrors(friction_factor=1.5, seed=1))
    assert other.plate_um.tobytes() == usual.plate_um.tobytes()
    assert other.score.contact_slip_um == usual.score.contact_slip_um
    assert other.score.fingers[1].bias_jnd < usual.score.fingers[1].bias_jnd < 0.0
