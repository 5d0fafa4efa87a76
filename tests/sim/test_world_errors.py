"""Laboratories with errors: what is drawn, what a file may say, and that each error acts where it should."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from hapticd.errors import SimulationError
from hapticd.sim import lockstep
from hapticd.sim.fingers.pad_noise import PadNoise
from hapticd.sim.fingers.paths import Circle, Strokes, Touch
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.lockstep import Settings
from hapticd.sim.perfect import perfect
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.world_causes import CentroidPath, JitteryLink, plate_from_pad, played_actors, sensor_settings
from hapticd.sim.world_errors import (
    CAUSES,
    NEUTRAL,
    FingerLoad,
    MapChange,
    PadPose,
    SensorErrors,
    WorldErrors,
)
from hapticd.sim.world_tolerances import LEVELS, TOLERANCES, draw

INNER_MM = np.stack(np.meshgrid(*[np.linspace(-55.0, 55.0, 23)] * 2), axis=-1)


def truth(**errors: Any) -> GroundTruth:
    return GroundTruth(PlateSettings(world=WorldErrors(**errors)))


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


@pytest.mark.parametrize("level", LEVELS)
def test_a_drawn_world_is_within_its_tolerances_and_the_same_again(level: str) -> None:
    bounds = {name: getattr(tolerance, level) for name, tolerance in TOLERANCES.items()}
    for seed in range(20):
        world = draw(level, seed)
        assert world == draw(level, seed) != draw(level, seed + 100)
        assert math.hypot(world.pad_pose.x_mm, world.pad_pose.y_mm) <= bounds["pad_shift"]
        assert abs(world.latency_ms) <= bounds["latency"]
        assert max(map(abs, world.sensors.gain_frac)) <= bounds["sensor_gain"]
        assert bounds["glue"] / 2 <= world.glue_frac <= bounds["glue"]  # never of the family that is fitted
        assert 1 / bounds["finger_damping"] <= world.finger_load.damping_factor <= bounds["finger_damping"]
        assert world.stop_ramp_s is not None
        assert world.stop_ramp_s >= bounds["stop_ramp"]


def test_every_cause_of_a_drawn_world_can_be_made_perfect_by_itself() -> None:
    world = draw("worst", 3)
    for cause in CAUSES:
        known = world.without(cause)
        assert getattr(world, cause) != getattr(NEUTRAL, cause)
        assert [name for name in CAUSES if getattr(known, name) != getattr(world, name)] == [cause]


def test_an_unknown_level_names_the_known_ones() -> None:
    with pytest.raises(SimulationError, match="mild, laboratory, worst"):
        draw("moon", 1)


def test_a_world_of_a_file_is_the_world_that_was_written() -> None:
    world = draw("laboratory", 2)
    assert WorldErrors.parsed(json.dumps(asdict(world))) == world
    assert WorldErrors.parsed('{"pad_pose": {"x_mm": 0.5}}') == WorldErrors(pad_pose=PadPose(x_mm=0.5))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[", "is a JSON object"),
        ("3", "give an object"),
        ('{"moon": 1}', "choose from pad_pose"),
        ('{"pad_pose": {"z_mm": 1}}', "choose from x_mm"),
        ('{"latency_ms": NaN}', "latency_ms is nan"),
        ('{"latency_ms": "3"}', "give a number"),
        ('{"glue_frac": -0.1}', "give 0 or more"),
        ('{"finger_load": {"damping_factor": 0}}', "above 0"),
        ('{"finger_load": {"force_frac": 1}}', "less than 1"),
        ('{"noise": {}}', "give noise_mm"),
        ('{"noise": {"noise_mm": "white"}}', "noise_mm is 'white': give a number"),
        ('{"noise": {"noise_mm": 0.1, "noise_correlation": 1}}', "correlation below 1"),
        ('{"pad_pose": {"scale_frac": -1}}', "more than -1"),
        ('{"lost_frac": 1}', "less than 1"),
        ('{"map_step_mm": 0}', "above 0"),
    ],
)
def test_a_world_that_cannot_be_is_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(SimulationError, match=sentence):
        WorldErrors.parsed(text)


def test_the_scans_of_driven_and_parasitic_modes_have_noise_of_their_own() -> None:
    plate = GroundTruth()
    exact = plate.shapes(INNER_MM)
    driven = np.moveaxis(plate.measured_mode_map(1).evaluate(INNER_MM.reshape(-1, 2)), 0, -1).reshape(2, -1)
    parasitic = np.moveaxis(plate.parasitic_modes(1).modes.evaluate(INNER_MM.reshape(-1, 2)), 0, -1).reshape(2, -1)
    errors = np.concatenate((driven, parasitic)) - np.moveaxis(exact, -1, 0).reshape(4, -1)
    assert np.abs(np.corrcoef(errors)[:2, 2:]).max() < 0.5


def test_a_map_that_changed_since_the_scan_is_not_what_the_scan_shows() -> None:
    usual, changed = GroundTruth(), truth(map_change=MapChange(0.1, 0.1), seed=4)
    difference = changed.shapes(INNER_MM) - usual.shapes(INNER_MM)
    shares = [rms(difference[..., mode]) / rms(usual.shapes(INNER_MM)[..., mode]) for mode in range(4)]
    assert all(0.05 < share < 0.3 for share in shares)
    assert np.abs(np.corrcoef(difference.reshape(-1, 4).T) - np.eye(4)).max() < 0.3  # each mode by itself
    at = INNER_MM.reshape(-1, 2)
    assert np.array_equal(changed.measured_mode_map(1).evaluate(at), usual.measured_mode_map(1).evaluate(at))


def test_glue_is_in_the_truth_and_in_the_scan() -> None:
    usual, glued = GroundTruth(), truth(glue_frac=0.2, seed=4)
    change = (glued.shapes(INNER_MM) - usual.shapes(INNER_MM))[..., :2].reshape(-1, 2)
    at = INNER_MM.reshape(-1, 2)
    seen = glued.measured_mode_map(1).evaluate(at) - usual.measured_mode_map(1).evaluate(at)
    assert rms(seen - change) < 0.5 * rms(change)


def test_sensors_multiply_what_they_measure() -> None:
    errors = SensorErrors((0.03, -0.02), (90.0,), ((0.0, 0.05), (0.0, 0.0)))
    matrix = errors.matrix(2)
    assert matrix == pytest.approx(np.array([[1.03j, 1.03j * 0.05], [0.0, 0.98]]))
    assert truth(sensors=errors).sensor == pytest.approx(matrix @ GroundTruth().sensor)


def test_modes_drift_apart_and_are_mistuned_together() -> None:
    plate, usual = truth(drift_hz=(100.0, -100.0), mistuning_hz=30.0), GroundTruth()
    apart_hz = (plate.drifted_rad_s(10.0) - usual.detuning_rad_s) / (2 * np.pi)
    assert apart_hz == pytest.approx([130.0, -70.0, 30.0, 30.0])
    assert plate.drifted_rad_s(0.0) == pytest.approx(plate.detuning_rad_s)
    assert plate.nominal_detuning_rad_s == pytest.approx(usual.nominal_detuning_rad_s)


def test_the_drift_reaches_the_plate() -> None:
    def last(world: WorldErrors) -> Any:
        settings = lockstep.in_world(Settings(), world)
        return lockstep.run("step", settings=settings, seconds=0.8).plate_um[-1]

    assert np.array_equal(last(WorldErrors(drift_hz=(0.0,))), last(NEUTRAL))
    assert not np.array_equal(last(WorldErrors(drift_hz=(80.0,))), last(NEUTRAL))


def test_a_finger_presses_more_and_less() -> None:
    plate = truth(finger_load=FingerLoad(2.0, 50.0, 0.5))
    decay_1_s, detuning_rad_s = plate.finger_load(np.linspace(0.0, 5.0, 500), 0)
    usual_1_s = 2.0 * GroundTruth().finger_decay_1_s
    assert (decay_1_s.min(), decay_1_s.max()) == pytest.approx((0.5 * usual_1_s, 1.5 * usual_1_s), rel=0.01)
    assert detuning_rad_s == pytest.approx(2 * np.pi * 50.0 * decay_1_s / usual_1_s)


def test_the_pad_lies_where_its_pose_says() -> None:
    placement = plate_from_pad(PadPose(1.0, -2.0, 90.0, 0.01))
    assert placement.apply(10.0, 0.0) == pytest.approx((1.0, -2.0 + 10.1))


def test_the_pad_has_the_noise_and_the_clock_of_its_world() -> None:
    world = WorldErrors(latency_ms=3.0, stamp_jitter_ms=2.0, noise=PadNoise(0.1, 0.5, 0.7, 0.02))
    pad = sensor_settings(world, latency_s=0.01, stamp_jitter_ms=1.0)
    assert pad.latency_s == pytest.approx(0.013)
    assert (pad.stamp_jitter_ms, pad.noise) == (3.0, world.noise)
    assert sensor_settings(NEUTRAL, noise=PadNoise(0.03)).noise == PadNoise(0.03)


def test_a_slow_pad_that_loses_reports_and_a_coarse_scan_are_a_world_too() -> None:
    pad = sensor_settings(WorldErrors(report_period_ms=1000 / 60, lost_frac=0.05), period_s=0.01125)
    assert (pad.period_s, pad.lost_frac) == (pytest.approx(1 / 60), 0.05)
    coarse, usual = (
        GroundTruth(PlateSettings(world=world)).measured_mode_map(1)
        for world in (WorldErrors(map_step_mm=7.0), NEUTRAL)
    )
    same = GroundTruth(PlateSettings(map_step_mm=7.0)).measured_mode_map(1)
    assert np.array_equal(coarse.shapes, same.shapes)
    assert not np.array_equal(coarse.shapes, usual.shapes)


def test_a_centroid_runs_ahead_of_a_moving_finger_and_not_of_one_at_rest() -> None:
    moving = Touch(Circle((0.0, 0.0), 20.0, 100.0), 0.1)
    t_s = np.array([0.0, 0.5, 1.0])
    ahead_mm = CentroidPath(moving, 0.5).position_mm(t_s) - moving.position_mm(t_s)
    assert np.isnan(ahead_mm[0]).all()
    assert np.hypot(*ahead_mm[1:].T) == pytest.approx([0.5, 0.5], rel=0.03)
    slow = Circle((0.0, 0.0), 20.0, 0.1)
    assert CentroidPath(slow, 0.5).position_mm(t_s) == pytest.approx(slow.position_mm(t_s), abs=0.005)


def test_a_jittery_link_keeps_the_order_of_messages() -> None:
    link = JitteryLink(5.0, 10.0, 1)
    arrivals_ns = [link.to_board_ns(t_ns) for t_ns in range(0, 100_000_000, 1_000_000)]
    delays_ms = (np.array(arrivals_ns) - np.arange(0, 100_000_000, 1_000_000)) * 1e-6
    assert (np.diff(arrivals_ns) >= 0).all()
    assert 5.0 <= delays_ms.min() < 10.0 < delays_ms.max() <= 15.0
    assert JitteryLink(5.0, 0.0, 1).to_host_ns(7) == 5_000_007


def test_strokes_stop_as_abruptly_as_the_world_says() -> None:
    (actor, _) = played_actors(SCENARIOS["strokes"].build(1, 100.0), WorldErrors(stop_ramp_s=0.1))
    assert isinstance(actor.path, Touch)
    assert isinstance(actor.path.path, Strokes)
    assert actor.path.path.ramp_s == 0.1


@pytest.mark.parametrize("level", ["mild", "worst"])
def test_a_run_in_a_drawn_world_repeats_itself_to_the_last_bit(level: str) -> None:
    settings = lockstep.in_world(Settings(), draw(level, 5))
    first, again = (lockstep.run("strokes", settings=settings, seconds=0.7) for _ in range(2))
    assert np.isfinite(first.plate_um).all()
    assert first.plate_um.tobytes() == again.plate_um.tobytes()
    assert first.plate_um.tobytes() != lockstep.run("strokes", seconds=0.7).plate_um.tobytes()


def test_perfect_knowledge_and_the_paper_play_in_the_same_world() -> None:
    settings = lockstep.in_world(Settings(), draw("worst", 5))
    played = lockstep.run("strokes", settings=replace(settings), seconds=0.8)
    assert lockstep.paper(played.settings).plate.world == settings.plate.world
    assert perfect(played).score.leak_um < 0.1 * played.score.leak_um


def test_the_plate_keeps_to_its_limit_in_truth_where_sensors_show_three_percent_too_little() -> None:
    settings = lockstep.in_world(Settings(), WorldErrors(sensors=SensorErrors((-0.03, -0.03))))
    played = lockstep.run("both-slip", settings=settings, seconds=0.7)
    assert played.score.largest_reference_um == pytest.approx(settings.config.limits.reference_limit_um[0], rel=1e-3)
    assert np.abs(played.modal_um).max() < settings.plate.w_limit_um
