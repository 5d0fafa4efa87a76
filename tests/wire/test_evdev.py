"""Input events of any Linux multitouch device: what they mean, and that no bytes do harm."""

from __future__ import annotations

import itertools
import math

import pytest
from input_events import BARE_SCREEN, END, SCREEN, axis, lifted, packed, placed

from hapticd.values import Contact, TouchFrame
from hapticd.wire.trackpad import Decoder, StillContacts, evdev
from hapticd.wire.trackpad.evdev import (
    BTN_LEFT,
    EV_KEY,
    EV_MSC,
    EV_SYN,
    MAX_CONTACTS,
    MSC_TIMESTAMP,
    ORIENTATION,
    POSITION_X,
    POSITION_Y,
    PRESSURE,
    SYN_DROPPED,
    SYN_MT_REPORT,
    TOOL_TYPE,
    TOUCH_MAJOR,
    TOUCH_MINOR,
    TRACKING_ID,
)

MS = 1_000_000
SEPARATOR = (EV_SYN, SYN_MT_REPORT, 0)
DROPPED = (EV_SYN, SYN_DROPPED, 0)


def frames(decoder: Decoder, *reports: list[tuple[int, int, int]]) -> list[TouchFrame]:
    """Each report with its SYN_REPORT, a period after the one before."""
    return [
        frame
        for index, events in enumerate(reports)
        for frame in decoder.decode(packed(index * 8 * MS, *events, END), index * 8 * MS)
    ]


def places(frame: TouchFrame) -> dict[int, tuple[float, float]]:
    return {contact.contact_id: (contact.x_mm, contact.y_mm) for contact in frame.contacts}


def only(frame: TouchFrame) -> Contact:
    (contact,) = frame.contacts
    return contact


# --- protocol B ---


def test_a_slot_is_a_contact_from_its_id_to_the_end_of_its_id() -> None:
    landed, moved, one, none = frames(
        Decoder(SCREEN),
        placed(0, 2000, 2000, 7) + placed(1, 3000, 1000, 8),
        placed(1, 3000, 900),
        lifted(0),
        lifted(1),
    )
    assert places(landed) == {7: (0.0, 0.0), 8: (100.0, 50.0)}
    assert places(moved) == {7: (0.0, 0.0), 8: (100.0, 55.0)}  # what is not sent has not changed
    assert places(one) == {8: (100.0, 55.0)}
    assert none.contacts == ()


def test_ten_contacts_are_ten_and_slots_beyond_sixteen_are_not_seen() -> None:
    (frame,) = frames(Decoder(SCREEN), [event for slot in range(10) for event in placed(slot, 100 * slot, 0, slot)])
    assert len(frame.contacts) == 10
    (full,) = frames(Decoder(SCREEN), [event for slot in range(-2, 30) for event in placed(slot, 9 * slot, 0, slot)])
    assert sorted(places(full)) == list(range(MAX_CONTACTS))


def test_an_ellipse_turns_clockwise_from_forward_in_units_of_positions() -> None:
    events = [*placed(0, 0, 0, 1), axis(TOUCH_MAJOR, 150), axis(TOUCH_MINOR, 75)]
    forward, turned = frames(Decoder(SCREEN), events, [axis(ORIENTATION, 90)])
    assert only(forward).angle_rad == pytest.approx(math.pi / 2)
    assert (only(forward).major_mm, only(forward).minor_mm) == pytest.approx((10.0, 5.0))  # 15 units per mm on average
    assert only(turned).angle_rad % math.pi == pytest.approx(0.0, abs=1e-9)


def test_an_ellipse_without_direction_or_minor_axis_is_a_disc() -> None:
    (ellipse,) = frames(Decoder(BARE_SCREEN), [*placed(0, 0, 0, 1), axis(TOUCH_MAJOR, 180), axis(TOUCH_MINOR, 45)])
    assert (only(ellipse).major_mm, only(ellipse).minor_mm) == pytest.approx((6.0, 6.0))
    (disc,) = frames(Decoder(SCREEN), [*placed(0, 0, 0, 1), axis(TOUCH_MAJOR, 150)])
    assert only(disc).major_mm == only(disc).minor_mm == pytest.approx(10.0)


def test_pressure_is_a_share_of_the_highest_and_none_where_the_device_has_none() -> None:
    events = [*placed(0, 0, 0, 1), axis(PRESSURE, 51)]
    assert only(frames(Decoder(SCREEN), events)[0]).pressure_frac == pytest.approx(0.2)
    assert only(frames(Decoder(BARE_SCREEN), events)[0]).pressure_frac == 0.0


@pytest.mark.parametrize("tool", [1, 2, 10, -1])  # pen, palm, dial, and none that the kernel knows
def test_a_pen_or_palm_is_no_fingertip_also_where_a_touch_becomes_one(tool: int) -> None:
    slots, anonymous_ones = placed(0, 0, 0, 1), [axis(POSITION_X, 1), axis(POSITION_Y, 1)]
    finger, other, again = frames(Decoder(SCREEN), slots, [axis(TOOL_TYPE, tool)], [axis(TOOL_TYPE, 0)])
    assert [only(frame).touching for frame in (finger, other, again)] == [True, False, True]
    (frame,) = frames(Decoder(SCREEN), [*anonymous_ones, axis(TOOL_TYPE, tool), SEPARATOR])
    assert not only(frame).touching


def test_a_click_pads_button_is_the_frames_and_other_events_mean_nothing() -> None:
    others = [(EV_KEY, 0x14A, 1), (EV_MSC, 4, 9), (EV_SYN, 7, 0), axis(0x00, 5), (9, 9, 9)]
    found = frames(Decoder(SCREEN), [(EV_KEY, BTN_LEFT, 1)], others, [(EV_KEY, BTN_LEFT, 0)])
    assert [(one.button, one.contacts) for one in found] == [(True, ()), (True, ()), (False, ())]


def test_after_dropped_events_fingers_stay_where_all_slots_are_reported() -> None:
    landed, told = frames(Decoder(SCREEN), placed(0, 2000, 2000, 7), [DROPPED, *lifted(0)], placed(0, 2200, 2000, 7))
    assert (places(landed), places(told)) == ({7: (0.0, 0.0)}, {7: (20.0, 0.0)})
    *_, untold = frames(Decoder(SCREEN), placed(0, 2000, 2000, 7), [DROPPED], [axis(POSITION_X, 5)])
    assert untold.contacts == ()


def test_a_report_may_come_in_pieces() -> None:
    decoder, events = Decoder(SCREEN), placed(0, 2000, 2000, 7)
    assert decoder.decode(packed(0, *events[:2]), 0) == ()
    (frame,) = decoder.decode(packed(0, *events[2:], END), 0)
    assert places(frame) == {7: (0.0, 0.0)}


# --- protocol A ---


def anonymous(*points: tuple[int, int]) -> list[tuple[int, int, int]]:
    placed_ = [[axis(POSITION_X, x), axis(POSITION_Y, y), SEPARATOR] for x, y in points]
    return [event for events in placed_ for event in events] or [SEPARATOR]


def test_contacts_without_numbers_keep_those_of_the_nearest_before() -> None:
    first, second, one, none = frames(
        Decoder(SCREEN),
        anonymous((1000, 1000), (1200, 1000)),
        anonymous((1210, 1000), (1010, 1000)),
        anonymous((1220, 1000)),
        anonymous(),
    )
    left, right = places(first)
    assert places(second) == {right: (-79.0, 50.0), left: (-99.0, 50.0)}
    assert list(places(one)) == [right]
    assert none.contacts == ()


def test_a_contact_far_from_all_before_is_a_new_one() -> None:
    first, second = frames(Decoder(SCREEN), anonymous((0, 0)), anonymous((4000, 0)))
    assert places(first).keys().isdisjoint(places(second))


def test_tracking_numbers_of_a_device_without_slots_are_used() -> None:
    numbered = [axis(TRACKING_ID, 4), axis(POSITION_X, 2000), axis(POSITION_Y, 2000), SEPARATOR]
    (frame,) = frames(Decoder(SCREEN), numbered)
    assert places(frame) == {4: (0.0, 0.0)}


def test_half_a_contact_is_none_and_more_than_sixteen_are_sixteen() -> None:
    (frame,) = frames(Decoder(SCREEN), [axis(POSITION_X, 5), SEPARATOR, *anonymous((1, 1))])
    assert len(frame.contacts) == 1
    (full,) = frames(Decoder(SCREEN), anonymous(*[(10 * n, 0) for n in range(40)]))
    assert len(full.contacts) == MAX_CONTACTS


def test_a_contact_without_a_number_is_lifted_by_a_pressure_of_0() -> None:
    def pressed(raw: int) -> list[tuple[int, int, int]]:
        return [axis(PRESSURE, raw), *anonymous((5, 5))]

    touched = frames(Decoder(SCREEN), pressed(9), pressed(0), pressed(9))
    assert [only(frame).touching for frame in touched] == [True, False, True]
    assert only(frames(Decoder(SCREEN), [*placed(0, 0, 0, 1), axis(PRESSURE, 0)])[0]).touching  # of protocol B


# --- time ---


def test_a_kernels_stamp_is_when_it_was_sampled() -> None:
    (frame,) = Decoder(SCREEN).decode(packed(5_000 * MS, END), 5_003 * MS)
    assert frame.t_ns == 5_000 * MS


def test_stamps_of_another_clock_begin_at_the_first_reading_and_keep_their_spacing() -> None:
    decoder = Decoder(SCREEN)
    times = [decoder.decode(packed(day * 86_400_000 * MS, END), t * MS)[0].t_ns for day, t in ((9, 70), (9, 90))]
    assert times == [70 * MS, 70 * MS]
    assert decoder.counters["clock_steps"] == 0
    (frame,) = decoder.decode(packed(MS, END), 100_000 * MS)
    assert (frame.t_ns, decoder.counters["clock_steps"]) == (100_000 * MS, 1)


def test_the_devices_own_counter_has_no_jitter_of_the_bus() -> None:
    decoder = Decoder(SCREEN)
    t_ns = []
    for index in range(1, 400):
        late_ns = (index * 7919 % 8) * MS
        stamp_ns = index * 8 * MS + late_ns
        counter = (EV_MSC, MSC_TIMESTAMP, index * 8000)
        t_ns.append(decoder.decode(packed(stamp_ns, counter, END), stamp_ns)[0].t_ns)
    gaps_ns = [later - earlier for earlier, later in itertools.pairwise(t_ns)]
    assert all(abs(gap_ns - 8 * MS) < 0.05 * MS for gap_ns in gaps_ns[1:])


def test_a_restarted_counter_is_no_step_and_one_in_a_wrong_unit_is_not_used() -> None:
    def stamped(decoder: Decoder, *counters_us: int) -> list[int]:
        return [
            decoder.decode(packed(n * 100 * MS, (EV_MSC, MSC_TIMESTAMP, us), END), n * 100 * MS)[0].t_ns
            for n, us in enumerate(counters_us)
        ]

    restarted = Decoder(SCREEN)
    assert stamped(restarted, 5_000, 0, 100_000) == [0, 100 * MS, 200 * MS]
    assert restarted.counters["clock_steps"] == 0
    wrong = Decoder(SCREEN)
    assert stamped(wrong, *range(1, 9)) == [n * 100 * MS for n in range(8)]
    assert wrong.counters["clock_steps"] == 3


# --- files, and any bytes ---


@pytest.mark.parametrize("data", [b"", b"\0", bytes(23), bytes(25), bytes(24 * (evdev.MAX_EVENTS + 1))])
def test_what_is_not_some_whole_events_is_refused(data: bytes) -> None:
    decoder = Decoder(SCREEN)
    assert decoder.decode(data, 0) == ()
    assert decoder.counters["length"] == 1


# --- contacts that lie still ---


def test_a_still_finger_is_repeated_at_the_devices_rate_until_it_is_lost() -> None:
    still = StillContacts()
    assert still.due_ns is None
    for index in range(20):
        still.took(index * 4 * MS, are_down=True)
    assert (still.period_ns, still.due_ns) == (4 * MS, 76 * MS + 6 * MS)
    assert still.repeat(82 * MS) == 80 * MS
    assert still.repeat(91 * MS) == 88 * MS  # the host was busy: whole periods later
    assert still.due_ns == 94 * MS
    still.repeat(10_076 * MS)
    assert still.due_ns is None


def test_nothing_is_repeated_after_the_last_lift_or_of_another_device() -> None:
    still = StillContacts()
    still.took(0, are_down=True)
    still.took(100 * MS, are_down=False)
    assert still.due_ns is None
    still.took(200 * MS, are_down=True)
    assert still.period_ns == 8_333_333  # a pause is no period
    still.reset()
    assert still.due_ns is None
