"""Laboratories with errors: what is drawn, what a file may say, and that each error acts where it should."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from hapticd.errors import SimulationError
from hapticd.sim import lockstep
from hapticd.sim.perfect import perfect
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.settings import Settings, in_world, paper_settings
from hapticd.sim.world_causes import sensor_settings
from hapticd.sim.world_errors import NEUTRAL, USUAL_MM_S, FingerLoad, PadPose, Skin, WorldErrors
from hapticd.sim.world_tolerances import LEVELS, TOLERANCES, draw


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
        assert bounds["centroid_finger"] / 2 <= world.centroids.finger_mm <= bounds["centroid_finger"]
        assert bounds["mixing"] / 2 <= world.mixing_deg <= bounds["mixing"]
        assert 1 / bounds["person"] <= world.friction_factor <= bounds["person"]
        assert abs(world.skin.drift_frac) <= bounds["skin_drift"]
        assert world.stop_ramp_s is not None
        assert world.stop_ramp_s >= bounds["stop_ramp"]
        assert world.contacts is not None
        assert 4.0 <= world.contacts.least_mm < 5.0 < world.contacts.most_mm <= 7.0


def test_fingers_of_a_person_differ_drift_and_depend_on_speed_and_force() -> None:
    t_s, at_100_mm_s = np.arange(0.0, 600.1, 0.1), np.full((6001, 2), USUAL_MM_S)
    still = WorldErrors(friction_factor=1.25, seed=3)
    assert still.amplitude_gains(t_s, at_100_mm_s) == pytest.approx(0.8)
    alike = replace(still, skin=Skin(drift_frac=0.1)).amplitude_gains(t_s, at_100_mm_s)
    assert alike[0] == pytest.approx(0.8)
    assert alike[-1] == pytest.approx(0.8 / 1.1)
    one, other = replace(still, skin=Skin(finger_ratio=1.1)).amplitude_gains(t_s, at_100_mm_s)[0].tolist()
    assert 0.8 / 1.1 <= min(one, other) < max(one, other) <= 0.8 * 1.1
    fast = replace(still, skin=Skin(speed_s_m=1.0)).amplitude_gains(t_s, 2.0 * at_100_mm_s)
    assert fast == pytest.approx(0.8 * 1.2 / 1.1)
    presses = replace(still, finger_load=FingerLoad(force_frac=0.4), skin=Skin(force_power=1 / 6))
    gains = presses.amplitude_gains(t_s, at_100_mm_s)
    assert (gains.min(), gains.max()) == pytest.approx((0.8 * 0.6 ** (1 / 6), 0.8 * 1.4 ** (1 / 6)), rel=1e-3)


def test_perfect_knowledge_has_the_person_s_curve() -> None:
    world = WorldErrors(friction_factor=0.7, skin=Skin(finger_ratio=1.2, speed_s_m=1.0), seed=2)
    for friction_targets in (False, True):
        settings = Settings(
            plate=replace(PlateSettings.of("wide"), world=world), motion="real", friction_targets=friction_targets
        )
        known = perfect(lockstep.run("strokes", settings=settings, seconds=1.2)).score
        assert known.felt_frac > 0.8
        assert abs(known.fingers[0].bias_jnd) < 0.5


def test_a_world_of_a_file_is_the_world_that_was_written() -> None:
    world = draw("laboratory", 2)
    assert WorldErrors.parsed(json.dumps(asdict(world))) == world
    assert WorldErrors.parsed('{"pad_pose": {"x_mm": 0.5}}') == WorldErrors(pad_pose=PadPose(x_mm=0.5))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[", "JSON object"),
        ("3", "JSON object"),
        ('{"moon": 1}', "choose from pad_pose"),
        ('{"pad_pose": {"z_mm": 1}}', "choose from x_mm"),
        ('{"latency_ms": NaN}', "JSON is malformed"),
        ('{"latency_ms": 1e999}', "out of range"),
        ('{"latency_ms": "3"}', "latency_ms"),
        ('{"finger_load": {"damping_factor": 0}}', "> 0.0.*damping_factor"),
        ('{"finger_load": {"force_frac": 1}}', "< 1.0.*force_frac"),
        ('{"noise": {}}', "noise_mm"),
        ('{"noise": {"noise_mm": 0.1, "noise_correlation": 1}}', "< 1.0.*noise_correlation"),
        ('{"pad_pose": {"scale_frac": -1}}', "> -1.0.*scale_frac"),
        ('{"contacts": {"most_mm": 99}}', "<= 10.0.*most_mm"),
    ],
)
def test_a_world_that_cannot_be_is_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(SimulationError, match=sentence):
        WorldErrors.parsed(text)


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


def test_perfect_knowledge_and_the_paper_play_in_the_same_world() -> None:
    settings = in_world(Settings(), draw("worst", 5))
    played = lockstep.run("strokes", settings=replace(settings), seconds=0.8)
    assert paper_settings(played.settings).plate.world == settings.plate.world
    assert perfect(played).score.leak_um < 0.1 * played.score.leak_um
