"""A person's fingers on the simulated plate: how they move, who takes over from whom, and what ends them."""

from __future__ import annotations

import math

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.errors import RequestError
from hapticd.sim.fingers.hands import MAX_HANDS, TIMEOUT_S, Hands, HeldFinger, YieldingPath, decode_hands
from hapticd.sim.fingers.paths import Rest


def at(finger: HeldFinger | YieldingPath, *t_s: float) -> list[list[float]]:
    return finger.position_mm(np.array(t_s)).tolist()


def down(hands: Hands, t_s: float) -> list[list[float]]:
    places = [at(finger, t_s)[0] for finger in hands.fingers]
    return [place for place in places if math.isfinite(place[0])]


def test_a_finger_that_is_no_longer_named_is_lifted_and_lands_as_another() -> None:
    hands = Hands()
    hands.hold({"1": (0.0, 0.0), "2": (9.0, 0.0)}, 0.0)
    hands.hold({"2": (9.0, 0.0)}, 1.0)
    assert down(hands, 1.0) == [[9.0, 0.0]]
    hands.hold({"1": (1.0, 1.0), "2": (9.0, 0.0)}, 1.01)
    assert [math.isfinite(at(finger, 2.0)[0][0]) for finger in hands.fingers] == [False, True, True, False, False]


def test_the_scenarios_fingers_leave_when_a_person_comes_and_do_not_return() -> None:
    hands = Hands()
    scripted = YieldingPath(Rest((3.0, 4.0)), hands)
    assert at(scripted, 0.0, 5.0) == [[3.0, 4.0]] * 2
    hands.hold({}, 2.0)
    hands.hold({}, 3.0)
    assert at(scripted, 1.99) == [[3.0, 4.0]]
    assert np.isnan(at(scripted, 2.0, 9.0)).all()


def test_the_scenarios_fingers_lift_on_request_and_land_again_after_it() -> None:
    hands = Hands()
    scripted = YieldingPath(Rest((3.0, 4.0)), hands)
    for t_s in (2.0, 2.4):
        hands.lift_scripted(t_s)
    assert at(scripted, 1.99, 2.4 + TIMEOUT_S) == [[3.0, 4.0]] * 2
    assert np.isnan(at(scripted, 2.0, 2.4, 2.39 + TIMEOUT_S)).all()
    hands.lift_scripted(9.0)
    assert at(scripted, 8.99, 9.0 + TIMEOUT_S) == [[3.0, 4.0]] * 2
    assert np.isnan(at(scripted, 9.0)).all()


def test_a_message_names_each_finger_and_its_place() -> None:
    assert decode_hands(msgpack.packb({"fingers": {"1": [1, -2.5], "left": [0.0, 0.0]}})) == {
        "1": (1.0, -2.5),
        "left": (0.0, 0.0),
    }
    assert decode_hands(msgpack.packb({"fingers": {}})) == {}
    assert decode_hands(msgpack.packb({"fingers": None})) is None


@pytest.mark.parametrize(
    "message",
    [
        {},
        [],
        {"fingers": [1]},
        {"fingers": {"1": [1.0]}},
        {"fingers": {"1": [1.0, math.nan]}},
        {"fingers": {"1": [1.0, 1e9]}},
        {"fingers": {"1": "23"}},
        {"fingers": {"": [0.0, 0.0]}},
        {"fingers": {"\x07" * 8: [0.0, 0.0]}},
        {"fingers": {str(finger): [0.0, 0.0] for finger in range(MAX_HANDS + 1)}},
        {"fingers": {}, "more": 1},
    ],
)
def test_what_holds_no_fingers_is_refused(message: object) -> None:
    with pytest.raises(RequestError):
        decode_hands(msgpack.packb(message))


@given(st.binary(max_size=80))
def test_any_bytes_are_fingers_or_a_refusal(payload: bytes) -> None:
    try:
        fingers = decode_hands(payload)
    except RequestError:
        return
    assert fingers is None or len(fingers) <= MAX_HANDS
