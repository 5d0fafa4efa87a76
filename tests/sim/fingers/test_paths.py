"""Finger paths: the stated speeds, smoothness, bounds and determinism."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.sim.fingers.paths import (
    Circle,
    Line,
    Path,
    Reach,
    Rest,
    Strokes,
    Touch,
    Touches,
    strokes_pair,
)

STEP_S = 1e-3
T_S = np.arange(0.0, 12.0, STEP_S)
MOVING = {
    "line": Line((-40.0, -6.0), (45.0, 20.0), 150.0),
    "reach": Reach((-30.0, 0.0), (30.0, 10.0)),
    "circle": Circle((5.0, -3.0), 20.0, -300.0, 1.0),
    "strokes": Strokes(4),
    "fast strokes": Strokes(5, 400.0),
    "avoiding strokes": strokes_pair(6)[1],
    "trembling rest": Rest((3.0, 4.0), tremor_mm=0.04, seed=1),
}


def speed_mm_s(positions: np.ndarray) -> np.ndarray:
    return np.hypot(*np.diff(positions, axis=0).T) / STEP_S


@pytest.mark.parametrize("path", MOVING.values(), ids=MOVING)
def test_a_path_is_independent_of_the_order_of_calls(path: Path) -> None:
    whole = path.position_mm(T_S)
    assert whole.shape == (len(T_S), 2)
    assert whole.dtype == np.float64
    one_by_one = np.concatenate([path.position_mm(T_S[i : i + 1]) for i in range(0, len(T_S), 701)])
    np.testing.assert_allclose(one_by_one, whole[::701], rtol=0, atol=1e-12)
    backwards = path.position_mm(T_S[::-1])[::-1]
    np.testing.assert_allclose(backwards, whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize("path", MOVING.values(), ids=MOVING)
def test_speed_has_no_steps(path: Path) -> None:
    velocity = np.diff(path.position_mm(T_S), axis=0) / STEP_S
    change_mm_s = np.hypot(*np.diff(velocity, axis=0).T)
    peak_mm_s = speed_mm_s(path.position_mm(T_S)).max()
    # A turn within 0.1 s along a half cosine accelerates by at most pi v / 0.1 s, which is above what strokes do;
    # tremor on each axis by a w^2.
    tremor_mm_s2 = math.sqrt(2) * 0.04 * (2 * math.pi * 9.0) ** 2
    assert change_mm_s.max() <= (1.05 * math.pi * peak_mm_s / 0.1 + tremor_mm_s2) * STEP_S


def test_a_line_cruises_at_the_stated_speed_between_its_points() -> None:
    line = Line((-40.0, -10.0), (40.0, 20.0), 120.0)
    positions = line.position_mm(T_S)
    speed = speed_mm_s(positions)
    assert speed.max() == pytest.approx(120.0, rel=1e-6)
    assert np.median(speed) == pytest.approx(120.0, rel=1e-6)
    np.testing.assert_allclose(positions[0], line.start_mm)
    length_mm = math.dist(line.start_mm, line.end_mm)
    way_mm = (positions - line.start_mm) @ np.subtract(line.end_mm, line.start_mm) / length_mm
    assert way_mm.min() >= -1e-9
    assert way_mm.max() == pytest.approx(length_mm, abs=1e-3)


def test_a_line_turns_within_its_turnaround() -> None:
    line = Line((0.0, 0.0), (50.0, 0.0), 100.0, turnaround_s=0.1)
    pass_s = (50.0 - 2 * 100.0 * 0.1 / math.pi) / 100.0 + 0.1
    t_s = pass_s + np.linspace(-0.05, 0.05, 101)
    x_mm = line.position_mm(t_s)[:, 0]
    expected = 50.0 - 100.0 * 0.1 / math.pi * (1 - np.cos((t_s - pass_s) * math.pi / 0.1))
    np.testing.assert_allclose(x_mm, expected, atol=1e-9)


def test_a_line_without_turnaround_bounces() -> None:
    x_mm = Line((0.0, 0.0), (10.0, 0.0), 10.0, turnaround_s=0.0).position_mm(np.array([0.0, 0.5, 1.0, 1.5, 2.25]))[:, 0]
    np.testing.assert_allclose(x_mm, [0.0, 5.0, 10.0, 5.0, 2.5], atol=1e-12)


def test_a_line_too_short_to_turn_on_is_refused() -> None:
    with pytest.raises(ValueError, match=r"6\.37 mm apart"):
        Line((0.0, 0.0), (6.0, 0.0), 100.0)


def test_a_reach_peaks_at_1_875_times_its_mean_speed_and_holds() -> None:
    reach = Reach((0.0, 0.0), (40.0, 30.0), duration_s=0.5, hold_s=0.25)
    speed = speed_mm_s(reach.position_mm(T_S))
    assert speed.max() == pytest.approx(1.875 * 50.0 / 0.5, rel=1e-4)
    np.testing.assert_array_equal(reach.position_mm(np.array([0.5, 0.6, 0.75])), [(40.0, 30.0)] * 3)
    np.testing.assert_allclose(reach.position_mm(np.array([1.25, 1.49, 1.5])), np.zeros((3, 2)), atol=1e-12)


def test_a_circle_keeps_its_radius_and_speed() -> None:
    circle = Circle((5.0, -3.0), 20.0, 150.0)
    positions = circle.position_mm(T_S)
    np.testing.assert_allclose(np.hypot(*(positions - circle.centre_mm).T), 20.0)
    np.testing.assert_allclose(speed_mm_s(positions), 150.0, rtol=1e-5)
    assert positions[1, 1] > positions[0, 1]  # anticlockwise


@given(st.integers(0, 2**31), st.floats(20.0, 600.0), st.floats(0.0, 2000.0))
@settings(deadline=None, max_examples=40)
def test_strokes_never_leave_the_plate(seed: int, speed: float, t_begin_s: float) -> None:
    positions = Strokes(seed, speed).position_mm(t_begin_s + np.arange(0.0, 20.0, 0.01))
    assert np.abs(positions).max() <= 58.0


@given(st.integers(0, 2**31))
@settings(deadline=None, max_examples=20)
def test_strokes_cruise_at_their_speed_and_rest_between(seed: int) -> None:
    bare = Strokes(seed, wobble_mm=0.0, tremor_mm=0.0)
    speed = speed_mm_s(bare.position_mm(T_S))
    assert speed.max() == pytest.approx(100.0, rel=1e-6)
    assert np.mean(speed > 99.9) > 0.35
    stops = np.flatnonzero(speed < 1e-9)
    runs_s = np.array([len(run) for run in np.split(stops, np.flatnonzero(np.diff(stops) > 1) + 1)]) * STEP_S
    assert len(runs_s) > 5
    assert runs_s.max() <= bare.pause_s + 2 * STEP_S


@pytest.mark.parametrize(("speed", "ramp_s"), [(100.0, 0.3), (150.0, 0.3), (100.0, 0.15)])
def test_a_stroke_accelerates_along_a_raised_cosine(speed: float, ramp_s: float) -> None:
    bare = Strokes(9, speed, ramp_s=ramp_s, wobble_mm=0.0, tremor_mm=0.0)
    acceleration = np.hypot(*np.diff(bare.position_mm(T_S), 2, axis=0).T) / STEP_S**2
    assert acceleration.max() == pytest.approx(math.pi * speed / (2 * ramp_s), rel=1e-3)


def test_an_everyday_stroke_peaks_like_a_reach_of_its_length_and_duration() -> None:
    duration_s = 80.0 / 100.0 + 0.3
    reach_mm_s2 = 10 / math.sqrt(3) * 80.0 / duration_s**2  # the quintic's peak, Flash and Hogan
    assert math.pi * 100.0 / (2 * Strokes(0).ramp_s) == pytest.approx(reach_mm_s2, rel=0.4)


def test_every_stroke_is_at_least_as_long_as_stated() -> None:
    bare = Strokes(3, wobble_mm=0.0, tremor_mm=0.0)
    positions = bare.position_mm(np.arange(0.0, 60.0, STEP_S))
    is_still = speed_mm_s(positions) < 1.0  # some waits are shorter than a step
    starts, ends = (np.flatnonzero(np.diff(is_still.astype(int)) == step) + 1 for step in (-1, 1))
    lengths_mm = [math.dist(positions[a], positions[b]) for a, b in zip(starts, ends[ends > starts[0]], strict=False)]
    assert len(lengths_mm) > 30
    assert min(lengths_mm) >= bare.min_stroke_mm - 0.02


def test_wobble_and_tremor_are_as_large_as_stated() -> None:
    bare = Strokes(3, wobble_mm=0.0, tremor_mm=0.0, half_size_mm=57.6)
    wobbling = Strokes(3, wobble_mm=0.4, tremor_mm=0.0, half_size_mm=58.0)  # of the same reach: the same strokes
    trembling = Strokes(3, wobble_mm=0.0, tremor_mm=0.02, half_size_mm=57.62)
    np.testing.assert_allclose([wobbling.reach_mm, trembling.reach_mm], bare.reach_mm)
    for path, largest_mm in ((wobbling, 0.4), (trembling, 0.02 * math.sqrt(2))):
        offset_mm = np.hypot(*(path.position_mm(T_S) - bare.position_mm(T_S)).T)
        assert 0.95 * largest_mm <= offset_mm.max() <= largest_mm + 1e-9


def test_strokes_reach_all_over_the_plate_and_seeds_differ() -> None:
    t_s = np.arange(0.0, 300.0, 0.05)
    first, second = Strokes(0).position_mm(t_s), Strokes(1).position_mm(t_s)
    for positions in (first, second):
        cells = {(int(x // 29), int(y // 29)) for x, y in positions}
        assert len(cells) == 16
    assert np.abs(np.corrcoef(first.T, second.T)[:2, 2:]).max() < 0.2


def test_the_second_of_a_pair_keeps_its_distance_far_more_than_chance_would() -> None:
    t_s = np.arange(0.0, 60.0, 0.01)
    near, near_by_chance = [], []
    for seed in range(4):
        first, second = strokes_pair(seed)
        alone = Strokes(second.seed)
        near.append(np.mean(np.hypot(*(first.position_mm(t_s) - second.position_mm(t_s)).T) < 18.0))
        near_by_chance.append(np.mean(np.hypot(*(first.position_mm(t_s) - alone.position_mm(t_s)).T) < 18.0))
    assert np.mean(near) < 0.02
    assert np.mean(near) < np.mean(near_by_chance) / 3


def test_strokes_that_do_not_fit_are_refused_and_times_must_be_finite() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        Strokes(0, half_size_mm=20.0)
    with pytest.raises(ValueError, match="speed_mm_s"):
        Strokes(0, speed_mm_s=0.0)
    for t_s in (math.nan, math.inf):
        with pytest.raises(ValueError, match="finite"):
            Strokes(0).position_mm(np.array([t_s]))


def test_a_touch_is_on_the_plate_from_down_until_up() -> None:
    touch = Touch(Rest((1.0, 2.0)), 0.5, 1.0)
    positions = touch.position_mm(np.array([0.0, 0.499, 0.5, 0.999, 1.0]))
    assert np.isnan(positions[[0, 1, 4]]).all()
    np.testing.assert_array_equal(positions[2:4], [(1.0, 2.0)] * 2)


def test_one_finger_may_land_several_times() -> None:
    finger = Touches((Touch(Rest((1.0, 1.0)), 0.0, 1.0), Touch(Rest((2.0, 2.0)), 2.0), Touch(Rest((3.0, 3.0)), 2.5)))
    x_mm = finger.position_mm(np.array([0.5, 1.5, 2.2, 3.0]))[:, 0]
    np.testing.assert_array_equal(x_mm, [1.0, np.nan, 2.0, 2.0])
