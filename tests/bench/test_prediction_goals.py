"""The goals that the default predictor is built for: 15 ms ahead, 100 Hz, 0.05 mm of noise, stamps off by 1 ms."""

from __future__ import annotations

from functools import cache

import pytest

from hapticd.bench.motions import MOTIONS, NOISE_MM, PERIOD_S, STAMP_ERROR_S, STEP_MM, Touch, touch
from hapticd.bench.prediction import overshoot_mm, rms_mm
from hapticd.core.prediction.predictor import make_predictor

# RMS in mm. The first six are what is asked for, the others what the models of constant jerk reach.
GOALS_MM = {
    "straight": 0.065,
    "slide": 0.13,
    "fast_straight": 0.08,
    "sine": 0.125,
    "reach": 0.175,
    "rest": 0.015,
    "fast_sine": 0.21,
    "circle": 0.16,
    "fast_circle": 0.26,
    "quiet_strokes": 0.072,
}
SEEDS = range(6)


@cache
def touches(motion: str) -> tuple[Touch, ...]:
    return tuple(touch(MOTIONS[motion], seed) for seed in SEEDS)


def test_the_pad_is_the_one_of_the_goals() -> None:
    assert (PERIOD_S, NOISE_MM, STEP_MM, STAMP_ERROR_S) == (0.010, 0.05, 0.02, 1e-3)


@pytest.mark.parametrize("motion", GOALS_MM)
def test_the_error_is_within_its_goal(motion: str) -> None:
    assert rms_mm(make_predictor, motion, touches(motion)) <= GOALS_MM[motion]


def test_a_reach_is_overshot_by_a_tenth_of_a_millimetre_at_most_in_the_mean() -> None:
    assert overshoot_mm(make_predictor, touches("reach")) <= 0.10


def test_a_motion_and_a_seed_give_the_same_touch_and_another_seed_another() -> None:
    for motion in MOTIONS.values():
        assert touch(motion, 1).samples == touch(motion, 1).samples != touch(motion, 2).samples
