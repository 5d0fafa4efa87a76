"""Rows of numbers: constant columns, each finger in one slot from landing to lift."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tools.stream.daemon_states import finger, plate_state

from hapticd.tools.stream.samples import Sampler, Slots


def test_columns_do_not_depend_on_the_fingers() -> None:
    sampler = Sampler(2)
    rows = [
        sampler.row(plate_state(), 0),
        sampler.row(plate_state(finger(3, 1.0)), 0),
        sampler.row(plate_state(finger(3, 1.0), finger(4, 2.0), finger(5, 3.0)), 0),
    ]
    assert len({tuple(row) for row in rows}) == 1
    assert [row["finger_1_x_mm"] for row in rows] == [None, 1.0, 1.0]
    assert [row["fingers"] for row in rows] == [0, 1, 3]


def test_a_finger_keeps_its_curve_when_an_older_one_lifts() -> None:
    sampler = Sampler(2)
    sampler.row(plate_state(finger(3), finger(4, 4.0)), 0)
    alone = sampler.row(plate_state(finger(4, 4.0)), 0)
    assert (alone["finger_1_id"], alone["finger_2_id"]) == (None, 4)
    joined = sampler.row(plate_state(finger(4, 4.0), finger(9)), 0)
    assert (joined["finger_1_id"], joined["finger_2_id"]) == (9, 4)


def test_time_is_that_of_the_wall_clock_and_of_the_daemon() -> None:
    row = Sampler(1).row(plate_state(), 1_700_000_000_000_000_000)
    assert row["t_s"] == 5.01
    assert row["timestamp"] == pytest.approx(1_700_000_005.01, abs=1e-6)


@given(st.lists(st.sets(st.integers(1, 8)), max_size=12), st.integers(1, 4))
def test_places_hold_only_fingers_that_are_down_each_once_and_for_as_long_as_it_is_down(
    hands: list[set[int]], count: int
) -> None:
    slots, before = Slots(count), [None] * count
    for down in hands:
        held = slots.assign(sorted(down))
        ids = [one for one in held if one is not None]
        assert len(ids) == len(set(ids)) == min(count, len(down))
        assert set(ids) <= down
        assert all(now == then for now, then in zip(held, before, strict=True) if then in down)
        before = list(held)
