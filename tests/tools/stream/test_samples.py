"""Each finger has one slot from landing to lift."""

from __future__ import annotations

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tools.stream.daemon_states import finger, plate_state

from hapticd.tools.stream.samples import Slots


@given(st.lists(st.sets(st.integers(1, 8)), max_size=12), st.integers(1, 4))
def test_slots_hold_fingers_that_are_down_each_once_until_it_lifts(hands: list[set[int]], count: int) -> None:
    slots, before = Slots(count), [None] * count
    for down in hands:
        held = slots.fingers(plate_state(*map(finger, sorted(down))))
        ids = [None if one is None else int(one.id) for one in held]
        found = {one for one in ids if one is not None}
        assert len(found) == min(count, len(down)) == count - ids.count(None)
        assert found <= down
        assert all(now == then for now, then in zip(ids, before, strict=True) if then in down)
        before = ids
    restarted = msgspec.structs.replace(plate_state(finger(8)), instance=8)
    assert [one and one.id for one in slots.fingers(restarted)] == [8] + [None] * (count - 1)
