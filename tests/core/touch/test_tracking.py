"""Fingers keep their ids through what trackpads do: reused, swapped, doubled and merged contact ids, lost reports."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from hapticd.core.touch.fingers import Tracker, _least_cost_columns
from hapticd.values import Contact, FingerFrame, TouchFrame

PERIOD_NS = 11_250_000
START_NS = 10**15

Spot = tuple[int, float, float]  # contact id, x_mm, y_mm


def contact(contact_id: int, x_mm: float, y_mm: float, touching: bool = True) -> Contact:
    return Contact(contact_id, x_mm, y_mm, 8.0, 7.0, 0.0, 0.3, touching, 4 if touching else 1, 0, 0)


def frame(index: float, *spots: Spot) -> TouchFrame:
    """A report `index` periods after the start."""
    return TouchFrame(START_NS + round(index * PERIOD_NS), tuple(contact(*spot) for spot in spots), False)


def track(*frames: TouchFrame) -> list[FingerFrame]:
    tracker = Tracker()
    return [tracker.update(each) for each in frames]


def ids(tracked: FingerFrame) -> list[int]:
    return [finger.finger_id for finger in tracked.fingers]


def ids_by_place(tracked: FingerFrame) -> dict[tuple[float, float], int]:
    return {(finger.x_mm, finger.y_mm): finger.finger_id for finger in tracked.fingers}


@pytest.mark.parametrize("speed_mm_s", [100.0, 500.0, 1500.0])
@pytest.mark.parametrize("moving", [8, 4])
def test_a_finger_that_moves_fast_or_stops_dead_stays_the_same_finger(speed_mm_s: float, moving: int) -> None:
    step_mm = speed_mm_s * PERIOD_NS * 1e-9
    frames = track(*(frame(k, (1, -60.0 + min(k, moving - 1) * step_mm, 0.0)) for k in range(8)))
    assert [ids(each) for each in frames] == [[1]] * 8


def test_a_jump_farther_than_a_finger_can_move_is_another_finger_under_the_same_id() -> None:
    _, _, jumped = track(frame(0, (1, -30.0, 0.0)), frame(1, (1, -30.0, 0.0)), frame(2, (1, 30.0, 0.0)))
    assert ids(jumped) == [2]
    assert jumped.fingers[0].is_new
    assert jumped.lifted == (1,)


def test_a_finger_stays_with_its_place_when_another_takes_its_id() -> None:
    """Finger 1 is renumbered and its old contact id goes to a finger that has just come down."""
    _, second = track(frame(0, (1, 0.0, 0.0)), frame(1, (1, 20.0, 0.0), (2, 0.2, 0.0)))
    assert ids_by_place(second) == {(0.2, 0.0): 1, (20.0, 0.0): 2}
    assert second.lifted == ()


@pytest.mark.parametrize("apart_mm", [12.0, 20.0, 80.0])
def test_fingers_keep_their_ids_when_the_device_swaps_its_own(apart_mm: float) -> None:
    frames = track(
        frame(0, (1, 0.0, 0.0), (2, apart_mm, 0.0)),
        frame(1, (1, 0.0, 1.0), (2, apart_mm, -1.0)),
        frame(2, (2, 0.0, 2.0), (1, apart_mm, -2.0)),
        frame(3, (2, 0.0, 3.0), (1, apart_mm, -3.0)),
    )
    assert ids_by_place(frames[2]) == {(0.0, 2.0): 1, (apart_mm, -2.0): 2}
    assert ids_by_place(frames[3]) == {(0.0, 3.0): 1, (apart_mm, -3.0): 2}
    assert all(not each.lifted for each in frames)
    assert [finger.contact_id for finger in frames[3].fingers] == [2, 1]


def test_fingers_that_pass_each_other_are_not_exchanged() -> None:
    """Side by side at 6 mm, 600 mm/s each: at the meeting each is nearest to where the *other* was."""
    step_mm = 600.0 * PERIOD_NS * 1e-9
    xs = [-30.0 + k * step_mm for k in range(10)]
    frames = track(*(frame(k, (1, x, 0.0), (2, -x, 6.0)) for k, x in enumerate(xs)))
    for x, tracked in zip(xs, frames, strict=True):
        assert ids_by_place(tracked) == {(x, 0.0): 1, (-x, 6.0): 2}


def test_of_merging_fingers_the_nearer_survives_and_the_split_makes_a_new_one() -> None:
    apart, merged, split = track(
        frame(0, (1, 0.0, 0.0), (2, 12.0, 0.0)),
        frame(1, (1, 8.0, 0.0)),  # the device keeps the id of the farther one
        frame(2, (1, 11.0, 0.0), (2, 0.0, 0.0)),
    )
    assert ids(apart) == [1, 2]
    assert (ids(merged), merged.lifted) == ([2], (1,))
    assert ids_by_place(split) == {(11.0, 0.0): 2, (0.0, 0.0): 3}


def test_contacts_that_do_not_touch_or_are_nowhere_are_ignored() -> None:
    tracker = Tracker()
    hovering = TouchFrame(
        START_NS,
        (
            contact(1, 0.0, 0.0, touching=False),
            contact(2, math.nan, 0.0),
            contact(3, 0.0, math.inf),
            contact(4, 5.0, 5.0),
        ),
        False,
    )
    assert [f.contact_id for f in tracker.update(hovering).fingers] == [4]
    left = tracker.update(TouchFrame(START_NS + PERIOD_NS, (contact(4, 5.0, 5.0, touching=False),), False))
    assert left.lifted == (1,)


@pytest.mark.parametrize("late_ns", [0, -1, -PERIOD_NS])
def test_a_frame_out_of_order_changes_nothing(late_ns: int) -> None:
    tracker = Tracker()
    tracker.update(frame(0, (1, 0.0, 0.0)))
    tracker.update(frame(1, (1, 1.0, 0.0)))
    stale = tracker.update(TouchFrame(START_NS + PERIOD_NS + late_ns, (contact(7, 50.0, 0.0),), False))
    assert stale.t_ns == START_NS + PERIOD_NS
    assert [(f.finger_id, f.x_mm, f.is_new) for f in stale.fingers] == [(1, 1.0, False)]
    assert stale.lifted == ()
    assert ids(tracker.update(frame(2, (1, 2.0, 0.0)))) == [1]


def test_after_a_long_silence_only_a_near_contact_with_the_same_id_continues() -> None:
    start = frame(0, (1, 0.0, 0.0), (2, 30.0, 0.0), (3, 60.0, 0.0))
    _, later = track(start, frame(20, (1, 4.0, 0.0), (2, 45.0, 0.0), (4, 60.0, 0.0)))
    assert ids_by_place(later) == {(4.0, 0.0): 1, (45.0, 0.0): 4, (60.0, 0.0): 5}
    assert later.lifted == (2, 3)


def test_reset_lifts_every_finger_uses_no_id_again_and_lets_time_start_anew() -> None:
    tracker = Tracker()
    tracker.update(frame(0, (1, 0.0, 0.0), (2, 20.0, 0.0)))
    tracker.reset()
    after = tracker.update(TouchFrame(0, (contact(1, 0.0, 0.0),), False))
    assert [(f.finger_id, f.is_new) for f in after.fingers] == [(3, True)]
    assert after.lifted == (1, 2)


@st.composite
def hands(draw: st.DrawFn) -> list[list[Spot]]:
    """Frames of fingers that come, wander and go, at least 16 mm apart, with the ids a faultless device gives."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    lanes = draw(st.integers(1, 5))
    frames: list[list[Spot]] = []
    places: dict[int, tuple[float, float]] = {}
    velocities: dict[int, tuple[float, float]] = {}
    for _ in range(draw(st.integers(2, 25))):
        for lane in range(lanes):
            if lane in places:
                if rng.random() < 0.1:
                    del places[lane]
                    continue
                x, y = places[lane]
                vx, vy = velocities[lane]
                home = 30.0 * lane - 60.0
                velocities[lane] = (0.8 * vx + rng.gauss(0, 0.3) + 0.05 * (home - x), 0.9 * vy + rng.gauss(0, 0.5))
                places[lane] = (x + velocities[lane][0], y + velocities[lane][1])
            elif rng.random() < 0.3:
                places[lane] = (30.0 * lane - 60.0, rng.uniform(-40.0, 40.0))
                velocities[lane] = (0.0, 0.0)
        frames.append([(lane + 1, x, y) for lane, (x, y) in places.items()])
    return frames


@settings(max_examples=60)
@given(hands(), st.randoms(use_true_random=False))
def test_permuted_contact_ids_give_the_same_paths(spots: list[list[Spot]], rng: random.Random) -> None:
    scrambled = [
        [(new_id, x, y) for new_id, (_, x, y) in zip(rng.sample(range(1, 16), len(each)), each, strict=True)]
        for each in spots
    ]

    def paths(source: list[list[Spot]]) -> set[tuple[tuple[int, float, float], ...]]:
        path_of: dict[int, list[tuple[int, float, float]]] = {}
        for k, tracked in enumerate(track(*(frame(k, *each) for k, each in enumerate(source)))):
            for finger in tracked.fingers:
                path_of.setdefault(finger.finger_id, []).append((k, finger.x_mm, finger.y_mm))
        return {tuple(path) for path in path_of.values()}

    assert paths(scrambled) == paths(spots)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (3, 3), (4, 9), (10, 16)])
def test_the_assignment_of_contacts_to_fingers_costs_as_little_as_scipys(rows: int, columns: int) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        costs = rng.uniform(0.0, 100.0, (rows, columns))
        found = _least_cost_columns(costs.tolist())
        assert len(set(found)) == rows
        assert costs[range(rows), found].sum() == pytest.approx(costs[linear_sum_assignment(costs)].sum())
    assert _least_cost_columns([[math.inf, 1.0, 9.0], [math.inf, 2.0, 9.0]]) == [1, 2]


places_mm = st.floats(-70.0, 70.0) | st.floats()
wild_contacts = st.builds(contact, st.integers(0, 6), places_mm, places_mm, touching=st.booleans())
wild_frames = st.lists(
    st.tuples(st.integers(-(10**7), 3 * 10**8), st.lists(wild_contacts, max_size=8)), min_size=1, max_size=20
)


@given(wild_frames)
def test_whatever_comes_each_id_begins_once_ends_once_and_holds_one_contact(
    steps: list[tuple[int, list[Contact]]],
) -> None:
    tracker = Tracker()
    t_ns, down, ever = 0, set(), set()
    for step_ns, contacts in steps:
        t_ns += step_ns
        tracked = tracker.update(TouchFrame(t_ns, tuple(contacts), False))
        now = set(ids(tracked))
        new = {finger.finger_id for finger in tracked.fingers if finger.is_new}
        assert ids(tracked) == sorted(now)
        assert len({finger.contact_id for finger in tracked.fingers}) == len(tracked.fingers)
        assert not new & ever
        assert new == now - down
        assert set(tracked.lifted) == down - now
        assert len(set(tracked.lifted)) == len(tracked.lifted)
        down, ever = now, ever | now
