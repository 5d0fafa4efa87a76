"""TUIO datagrams: what they mean, in which order they count, and that hostile ones do no harm."""

from __future__ import annotations

import math

import pytest
from datagrams import bundle, message, tuio1, tuio2

from hapticd.values import AffineMap, TouchFrame
from hapticd.wire.trackpad import Decoder, from_fields, to_fields, tuio

MS = 1_000_000
PAD = tuio.surface(400.0, 200.0)


def heard(decoder: Decoder, *datagrams: bytes, t_ns: int = 0, period_ms: int = 10) -> list[TouchFrame]:
    return [
        frame for index, data in enumerate(datagrams) for frame in decoder.decode(data, t_ns + index * period_ms * MS)
    ]


def places(frame: TouchFrame) -> dict[int, tuple[float, float]]:
    return {one.contact_id: (round(one.x_mm, 2), round(one.y_mm, 2)) for one in frame.contacts}


@pytest.mark.parametrize("version", [1, 2])
def test_contacts_are_where_they_are_on_the_surface_until_they_are_no_longer_alive(version: int) -> None:
    def said(frame: int, where: dict[int, tuple[float, float]]) -> bytes:
        return tuio1(frame, where) if version == 1 else tuio2(frame, frame * 10 * MS, where)

    both, one, none = heard(
        Decoder(PAD), said(1, {7: (0.5, 0.5), 8: (0.75, 0.25)}), said(2, {8: (0.75, 0.0)}), said(3, {})
    )
    assert places(both) == {7: (0.0, 0.0), 8: (100.0, 50.0)}
    assert places(one) == {8: (100.0, 100.0)}
    assert none.contacts == ()


def test_a_contact_that_is_alive_and_not_set_has_not_moved() -> None:
    still = bundle(message("/tuio/2Dcur", "alive", 7), message("/tuio/2Dcur", "fseq", 2))
    first = bundle(
        message("/tuio/2Dcur", "alive", 7),
        message("/tuio/2Dcur", "set", 7, 0.5, 0.5, 0.0, 0.0, 0.0),
        message("/tuio/2Dcur", "fseq", 1),
    )
    assert [places(frame) for frame in heard(Decoder(PAD), first, still)] == [{7: (0.0, 0.0)}] * 2


def test_an_empty_bundle_repeats_the_last_frame() -> None:
    first, again = heard(Decoder(PAD), tuio1(1, {7: (0.5, 0.5)}), bundle())
    assert (places(again), again.t_ns - first.t_ns) == (places(first), 10 * MS)


def test_tuio_2_has_pressure_and_the_trackers_own_time() -> None:
    t_ns = 3_900_000_000 * 1_000_000_000  # seconds since 1900
    decoder = Decoder(PAD)
    frames = [
        frame
        for index, late_ms in enumerate((0, 7, 3))
        for frame in decoder.decode(tuio2(index, t_ns + index * 8 * MS, {1: (0.5, 0.5)}), (index * 8 + late_ms) * MS)
    ]
    assert [frame.t_ns for frame in frames] == [0, 8 * MS, 16 * MS]
    assert frames[0].contacts[0].pressure_frac == 0.5


def test_a_tuio_2_pointer_without_its_pressure_is_no_contact() -> None:
    short = bundle(
        message("/tuio2/frm", 1, 10 * MS, 640 << 16 | 480, "tracker", times=(1,)),
        message("/tuio2/ptr", 1, 0, 0, 0.5, 0.5, 0.0, 0.0, 0.01),
        message("/tuio2/alv", 1),
    )
    assert heard(Decoder(PAD), short)[0].contacts == ()


def test_a_frame_that_comes_late_or_twice_is_refused_and_a_tracker_that_begins_again_is_not() -> None:
    decoder = Decoder(PAD)
    numbers = [500, 501, 501, 499, 502, 1, -1]
    assert len(heard(decoder, *[tuio1(number, {1: (0.5, 0.5)}) for number in numbers])) == 5
    assert decoder.counters["duplicate_id"] == 2


def test_another_source_is_heard_only_after_the_first_has_been_silent() -> None:
    decoder = Decoder(PAD)
    mine, other = tuio1(1, {1: (0.5, 0.5)}), tuio1(9, {2: (0.1, 0.1)}, source="other")
    assert len(heard(decoder, mine, other)) == 1
    assert decoder.counters["foreign"] == 1
    assert [places(frame).keys() for frame in heard(decoder, other, t_ns=1_000 * MS)] == [{2}]


def test_more_than_sixteen_contacts_are_sixteen_and_places_far_away_are_none() -> None:
    (frame,) = heard(Decoder(PAD), tuio1(1, {number: (0.01 * number, 0.5) for number in range(30)}))
    assert len(frame.contacts) == tuio.MAX_CONTACTS
    bad = {1: (math.nan, 0.5), 2: (0.5, math.inf), 3: (9.0, 0.5), 4: (0.5, 0.5)}
    assert list(places(heard(Decoder(PAD), tuio1(1, bad))[0])) == [4]
    many = [
        bundle(
            *[message("/tuio/2Dcur", "set", k, 0.5, 0.5) for k in range(100)],
            message("/tuio/2Dcur", "alive", 31, 99),
            message("/tuio/2Dcur", "fseq", 1),
        )
    ]
    assert list(places(heard(Decoder(PAD), *many)[0])) == [31]


def test_a_datagram_can_be_placed_again_and_forgets_after_a_reset() -> None:
    decoder = Decoder(PAD)
    heard(decoder, tuio1(5, {1: (0.75, 0.5)}))
    decoder.place(AffineMap(0.0, -1.0, 1.0, 0.0))
    assert places(heard(decoder, bundle())[0]) == {1: (0.0, 100.0)}
    decoder.reset()
    assert heard(decoder, bundle())[0].contacts == ()
    assert decoder.counters["clock_steps"] == 0


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bundle(bundle()),
        bundle(message("/tuio/2Dcur", "alive", 1)),
        message("/tuio/2Dobj", "fseq", 1),
        bundle(message("/tuio/2Dcur"), message("/tuio/2Dcur", "fseq", "one"), message("/tuio2/frm", 1)),
        bundle(message("/tuio2/ptr", *["x"] * 9), message("/tuio2/ptr", 1)),
    ],
)
def test_what_is_no_frame_is_refused(data: bytes) -> None:
    decoder = Decoder(PAD)
    assert decoder.decode(data, 0) == ()
    counters = decoder.counters
    assert counters["length"] + counters["foreign"] == 1


def test_one_message_alone_may_be_a_frame() -> None:
    assert len(heard(Decoder(PAD), message("/tuio/2Dcur", "fseq", 1))) == 1


def test_the_surface_is_known_from_a_file() -> None:
    assert from_fields(to_fields(PAD)).geometry == PAD.geometry
