"""A virtual finger is where its path, its speed and the clock say, however long it has been walking."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.targets.virtual_paths import Walk
from hapticd_contract.surfaces import VirtualPath

START_NS = 7_123_456_789_000
LINE = VirtualPath(((-40.0, 20.0), (40.0, 20.0)), 50.0, loop=True)  # 1.6 s there, 1.6 s back
HOOK = VirtualPath(((0.0, 0.0), (30.0, 0.0), (30.0, 0.0), (30.0, 40.0)), 10.0, loop=False)

coordinate = st.floats(-100, 100)
paths = st.builds(
    VirtualPath,
    st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=8).map(tuple),
    st.floats(0, 2000),
    st.booleans(),
)


def at(path: VirtualPath, t_s: float) -> tuple[float, float]:
    return Walk(path, START_NS).position_mm(START_NS + round(t_s * 1e9))


def test_a_loop_goes_there_and_back_at_constant_speed_from_its_first_point() -> None:
    for t_s, x_mm in (
        (-3.0, -40.0),
        (0.0, -40.0),
        (0.4, -20.0),
        (1.6, 40.0),
        (2.0, 20.0),
        (3200.4, -20.0),
        (86_400.4, -20.0),
    ):
        assert at(LINE, t_s) == pytest.approx((x_mm, 20.0), abs=1e-8)


# --- its turns --------------------------------------------------------------------------------------------------


def turns_ms(path: VirtualPath, t_s: float, span_s: float, most: int = 8) -> list[float]:
    turns_ns = Walk(path, START_NS).turns_ns(START_NS + round(t_s * 1e9), round(span_s * 1e9), most)
    return [turn_ns * 1e-6 for turn_ns in turns_ns]


def test_a_path_turns_at_its_corners_and_where_it_begins_and_ends() -> None:
    assert turns_ms(LINE, -0.5, 4.0) == pytest.approx([500.0, 2100.0, 3700.0])
    assert turns_ms(HOOK, 1.0, 10.0) == pytest.approx([2000.0, 6000.0])
    assert turns_ms(HOOK, 8.0, 10.0) == []
    assert turns_ms(LINE, 0.1, 0.01) == []


@given(paths, st.floats(-1.0, 1e9), st.integers(1, 8))
def test_turns_are_within_the_span_in_order_and_bounded(path: VirtualPath, t_s: float, most: int) -> None:
    found_ms = turns_ms(path, t_s, 0.017, most)
    assert len(found_ms) <= most
    assert found_ms == sorted(found_ms)
    assert all(0.0 <= turn_ms <= 17.0 for turn_ms in found_ms)
