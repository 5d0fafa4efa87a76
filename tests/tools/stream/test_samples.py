"""Each finger has one slot from landing to lift."""

from __future__ import annotations

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tools.stream.daemon_states import finger, plate_state

from hapticd.tools.stream.samples import Sampler, Slots


def test_a_finger_keeps_its_slot_until_it_lifts_or_the_daemon_restarts() -> None:
    sampler = Sampler(2)

    def ids(*fingers: int, instance: int = 7) -> list[int | None]:
        state = msgspec.structs.replace(plate_state(*map(finger, fingers)), instance=instance)
        return [None if one is None else int(one.id) for one in sampler.fingers(state)]

    assert ids(3, 4, 5) == [3, 4]
    assert ids(4) == [None, 4]
    assert ids(4, 9) == [9, 4]
    assert ids(4, instance=8) == [4, None]


@given(st.lists(st.sets(st.integers(1, 8)), max_size=12), st.integers(1, 4))
def test_slots_hold_fingers_that_are_down_each_once_until_it_lifts(hands: list[set[int]], count: int) -> None:
    slots, before = Slots(count), [None] * count
    for down in hands:
        held = slots.assign(sorted(down))
        ids = [one for one in held if one is not None]
        assert len(ids) == len(set(ids)) == min(count, len(down))
        assert set(ids) <= down
        assert all(now == then for now, then in zip(held, before, strict=True) if then in down)
        before = list(held)
