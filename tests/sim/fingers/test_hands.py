"""A person's fingers on the simulated plate: how they move, who takes over from whom, and what ends them."""

from __future__ import annotations

import math

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.errors import RequestError
from hapticd.sim.fingers.hands import GLIDE_S, RETURN_S, TIMEOUT_S, Hands, HeldFinger, YieldingPath, decode_hands
from hapticd.sim.fingers.paths import Rest
from hapticd_contract.simulated import MAX_TOUCHES, SimulatedTouch


def at(finger: HeldFinger | YieldingPath, *t_s: float) -> list[list[float]]:
    return finger.position_mm(np.array(t_s)).tolist()


def down(hands: Hands, t_s: float) -> list[list[float]]:
    places = [at(finger, t_s)[0] for finger in hands.fingers]
    return [place for place in places if math.isfinite(place[0])]


def test_a_finger_that_is_no_longer_named_is_lifted_and_lands_as_another() -> None:
    hands = Hands()
    hands.hold({"1": SimulatedTouch(0.0, 0.0), "2": SimulatedTouch(9.0, 0.0)}, 0.0)
    hands.hold({"2": SimulatedTouch(9.0, 0.0)}, 1.0)
    assert down(hands, 1.0) == [[9.0, 0.0]]
    hands.hold({"1": SimulatedTouch(1.0, 1.0), "2": SimulatedTouch(9.0, 0.0)}, 1.01)
    assert [math.isfinite(at(finger, 2.0)[0][0]) for finger in hands.fingers] == [False, True, True, False, False]


@pytest.mark.parametrize("end", ["lifted", "silent"])
def test_the_scenarios_fingers_leave_when_a_user_comes_and_return_after_it(end: str) -> None:
    hands = Hands()
    scripted = YieldingPath(Rest((3.0, 4.0)), hands)
    hands.hold({}, 1.0)  # of a page without touches
    assert at(scripted, 0.0, 5.0) == [[3.0, 4.0]] * 2
    for t_s in (2.0, 2.4, 2.8):
        hands.hold({"1": SimulatedTouch(0.0, 0.0)}, t_s)
    if end == "lifted":
        hands.hold({}, 3.0)
    hands.expire(2.9 + TIMEOUT_S)
    assert down(hands, 3.0 + TIMEOUT_S) == []
    assert at(scripted, 1.99, 2.8 + RETURN_S) == [[3.0, 4.0]] * 2
    assert np.isnan(at(scripted, 2.0, 2.4, 2.79 + RETURN_S)).all()


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


def test_a_sender_lifts_none_of_anothers_fingers_and_falls_silent_alone() -> None:
    hands = Hands()
    hands.hold({"1": SimulatedTouch(1.0, 0.0)}, 0.0, "page")
    hands.hold({"1": SimulatedTouch(2.0, 0.0)}, 0.0, "script")
    assert down(hands, 0.1) == [[1.0, 0.0], [2.0, 0.0]]
    hands.hold({"1": SimulatedTouch(2.0, 0.0)}, 0.4, "script")
    hands.expire(TIMEOUT_S + 0.1)
    assert down(hands, TIMEOUT_S + 0.2) == [[2.0, 0.0]]
    hands.expire(TIMEOUT_S + 0.5)
    assert down(hands, TIMEOUT_S + 0.6) == []


def test_a_finger_for_which_the_hand_has_no_room_is_not_there() -> None:
    hands = Hands()
    for finger in range(MAX_TOUCHES + 3):
        hands.hold({"1": SimulatedTouch(float(finger), 0.0)}, 0.0, str(finger))
    assert [x_mm for x_mm, _ in down(hands, 0.1)] == list(range(MAX_TOUCHES))
    assert len(hands._t_message_s) == MAX_TOUCHES


def test_a_finger_presses_harder_within_a_glide_and_its_contact_grows_with_it() -> None:
    finger = HeldFinger()
    finger.land(0.0, SimulatedTouch(0.0, 0.0))
    finger.move(1.0, SimulatedTouch(0.0, 0.0, 0.33))
    at_s = np.array([0.5, 1.0, 1.0 + GLIDE_S, 2.0])
    np.testing.assert_allclose(finger.pressure_frac(at_s), [0.11, 0.11, 0.33, 0.33])
    areas_mm2 = math.pi * np.linalg.det(finger.ellipses_mm(at_s))
    np.testing.assert_allclose(areas_mm2, math.pi * 25.0 * np.array([1.0, 1.0, 3 ** (2 / 3), 3 ** (2 / 3)]))
    finger.move(2.0, SimulatedTouch(0.0, 0.0, 0.33, 14.0, 8.0, math.pi / 2))
    np.testing.assert_allclose(finger.ellipses_mm(np.array([3.0])), [[[4.0, 0.0], [0.0, 7.0]]], atol=1e-12)


def test_a_message_names_each_finger_its_place_and_maybe_its_pressure_and_contact() -> None:
    def decoded(fingers: object) -> object:
        return decode_hands(msgpack.packb({"fingers": fingers})).fingers

    assert decoded({"1": [1, -2.5], "left": [0.0, 0.0, 0.5], "right": [0.0, 0.0, 0.5, 12.0, 10.0, 0.1]}) == {
        "1": SimulatedTouch(1.0, -2.5),
        "left": SimulatedTouch(0.0, 0.0, 0.5),
        "right": SimulatedTouch(0.0, 0.0, 0.5, 12.0, 10.0, 0.1),
    }
    assert decoded({}) == {}
    assert decoded(None) is None


@pytest.mark.parametrize(
    "message",
    [
        {},
        [],
        {"fingers": [1]},
        {"fingers": {"1": [1.0, math.nan]}},
        {"fingers": {"1": [1.0, 1.0, 1.1]}},
        {"fingers": {"1": [1.0, 1.0, 0.5, 12.0]}},
        {"fingers": {"": [0.0, 0.0]}},
        {"fingers": {"\x07" * 8: [0.0, 0.0]}},
        {"fingers": {str(finger): [0.0, 0.0] for finger in range(MAX_TOUCHES + 1)}},
        {"fingers": {}, "more": 1},
    ],
)
def test_what_holds_no_fingers_is_refused(message: object) -> None:
    with pytest.raises(RequestError):
        decode_hands(msgpack.packb(message))


@given(st.binary(max_size=80))
def test_any_bytes_are_fingers_or_a_refusal(payload: bytes) -> None:
    try:
        fingers = decode_hands(payload).fingers
    except RequestError:
        return
    assert fingers is None or len(fingers) <= MAX_TOUCHES
