"""TUIO datagrams: what they mean, in which order they count, and that hostile ones do no harm."""

from __future__ import annotations

import math

import pytest
from datagrams import bundle, message, tuio1, tuio2

from hapticd.values import AffineMap, TouchFrame
from hapticd.wire import osc
from hapticd.wire.trackpad import Decoder, tuio

MS = 1_000_000
PAD = tuio.surface(400.0, 200.0)


def received(decoder: Decoder, *datagrams: bytes, t_ns: int = 0, period_ms: int = 10) -> list[TouchFrame]:
    return [
        frame for index, data in enumerate(datagrams) for frame in decoder.decode(data, t_ns + index * period_ms * MS)
    ]


def places(frame: TouchFrame) -> dict[int, tuple[float, float]]:
    return {one.contact_id: (round(one.x_mm, 2), round(one.y_mm, 2)) for one in frame.contacts}


@pytest.mark.parametrize("version", [1, 2])
def test_contacts_are_where_they_are_on_the_surface_until_they_are_no_longer_alive(version: int) -> None:
    def said(frame: int, where: dict[int, tuple[float, float]]) -> bytes:
        return tuio1(frame, where) if version == 1 else tuio2(frame, frame * 10 * MS, where)

    both, one, none = received(
        Decoder(PAD), said(1, {7: (0.5, 0.5), 8: (0.75, 0.25)}), said(2, {8: (0.75, 0.0)}), said(3, {})
    )
    assert places(both) == {7: (0.0, 0.0), 8: (100.0, 50.0)}
    assert places(one) == {8: (100.0, 100.0)}
    assert none.contacts == ()


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
    assert received(Decoder(PAD), short)[0].contacts == ()


def test_late_and_repeated_frames_are_refused_a_restarted_tracker_is_not() -> None:
    decoder = Decoder(PAD)
    numbers = [500, 501, 501, 499, 502, 1, -1]
    assert len(received(decoder, *[tuio1(number, {1: (0.5, 0.5)}) for number in numbers])) == 5
    assert decoder.counters["duplicate_id"] == 2


def test_another_source_is_heard_only_after_the_first_has_been_silent() -> None:
    decoder = Decoder(PAD)
    mine, other = tuio1(1, {1: (0.5, 0.5)}), tuio1(9, {2: (0.1, 0.1)}, source="other")
    assert len(received(decoder, mine, other)) == 1
    assert decoder.counters["foreign"] == 1
    assert [places(frame).keys() for frame in received(decoder, other, t_ns=tuio.SILENT_NS)] == [{2}]


def test_more_than_sixteen_contacts_are_sixteen_and_places_far_away_are_none() -> None:
    (frame,) = received(Decoder(PAD), tuio1(1, {number: (0.01 * number, 0.5) for number in range(30)}))
    assert len(frame.contacts) == tuio.MAX_CONTACTS
    bad = {1: (math.nan, 0.5), 2: (0.5, math.inf), 3: (9.0, 0.5), 4: (0.5, 0.5)}
    assert list(places(received(Decoder(PAD), tuio1(1, bad))[0])) == [4]
    many = [
        bundle(
            *[message("/tuio/2Dcur", "set", k, 0.5, 0.5) for k in range(100)],
            message("/tuio/2Dcur", "alive", 31, 99),
            message("/tuio/2Dcur", "fseq", 1),
        )
    ]
    assert list(places(received(Decoder(PAD), *many)[0])) == [31]


def test_a_reset_drops_the_contacts() -> None:
    decoder = Decoder(PAD, AffineMap(0.0, -1.0, 1.0, 0.0))
    received(decoder, tuio1(5, {1: (0.75, 0.5)}))
    assert places(received(decoder, bundle())[0]) == {1: (0.0, 100.0)}
    decoder.reset()
    assert received(decoder, bundle())[0].contacts == ()
    assert decoder.counters["clock_steps"] == 0


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bundle(bundle()),
        message("/tuio/2Dobj", "fseq", 1),
        message("/tuio/2Dobj") + b"\0,ss\0source\0\0other\0\0\0",
        bundle(message("/tuio/2Dcur"), message("/tuio/2Dcur", "fseq", "one"), message("/tuio2/frm", 1)),
        bundle(message("/tuio2/ptr", *["x"] * 9), message("/tuio2/ptr", 1)),
    ],
)
def test_what_is_no_frame_is_refused(data: bytes) -> None:
    decoder = Decoder(PAD)
    assert decoder.decode(data, 0) == ()
    counters = decoder.counters
    assert counters["length"] + counters["foreign"] == 1


CUR = "/tuio/2Dcur"
PLACED = {7: (0.0, 0.0), 8: (100.0, 50.0)}
SHARES = {7: (0.5, 0.5), 8: (0.75, 0.25)}


def profile(name: str, *rest: float, number: int = 1) -> bytes:
    """A frame of another profile of TUIO 1.1, of which a contact's set goes on with `rest` after x and y."""
    return bundle(
        message(name, "source", "tracker"),
        message(name, "alive", *SHARES),
        *[message(name, "set", session, *place, *rest) for session, place in SHARES.items()],
        message(name, "fseq", number),
    )


def of_type(kind: str, frames: int = 1) -> list[bytes]:
    """Frames whose numbers are all of one type."""
    return [
        bundle(
            message(CUR, "alive", *SHARES, kinds="s" + 2 * kind),
            *[message(CUR, "set", s, *place, 0.0, 0.0, 0.0, kinds="s" + 6 * kind) for s, place in SHARES.items()],
            message(CUR, "fseq", number + 1, kinds="s" + kind),
        )
        for number in range(frames)
    ]


def sets(*sessions: int) -> list[bytes]:
    return [message(CUR, "set", session, *SHARES[session], 0.0, 0.0, 0.0) for session in sessions]


def alone(frame: int, *, end: bool = True) -> list[bytes]:
    return [
        message(CUR, "source", "tracker"),
        message(CUR, "alive", *SHARES),
        *sets(*SHARES),
        *([message(CUR, "fseq", frame)] if end else []),
    ]


def split(frame: int) -> list[bytes]:
    """A frame in a datagram for each contact."""
    return [bundle(message(CUR, "alive", *SHARES), *sets(one), message(CUR, "fseq", frame)) for one in SHARES]


def alone_2(frame: int) -> list[bytes]:
    return [
        message("/tuio2/frm", frame, 0, 640 << 16 | 480, "tracker", times=(1,)),
        *[message("/tuio2/ptr", n, 0, 0, x, y, 0.0, 0.0, 0.01, 0.5) for n, (x, y) in SHARES.items()],
        message("/tuio2/alv", *SHARES),
    ]


def bounds(*, tokens: tuple[int, ...] = ()) -> bytes:
    return bundle(
        message("/tuio2/frm", 1, 0.0, 0, "tracker"),
        *[message("/tuio2/tok", token, 0, 4, 0.1, 0.1, 0.0) for token in tokens],
        *[message("/tuio2/bnd", n, x, y, 0.0, 0.1, 0.1, 0.01) for n, (x, y) in SHARES.items()],
        *[message("/tuio2/bnd", token, 0.1, 0.1, 0.0, 0.1, 0.1, 0.01) for token in tokens],
        message("/tuio2/alv", *SHARES, *tokens),
    )


@pytest.mark.parametrize(
    ("datagrams", "frames"),
    [
        pytest.param([*alone(1), *alone(2)], 2, id="one message a datagram"),
        pytest.param([*alone_2(1), *alone_2(2)], 2, id="one message a datagram, 2.0"),
        pytest.param(of_type("f"), 1, id="floats, as of JavaScript"),
        pytest.param(of_type("d"), 1, id="doubles"),
        pytest.param([tuio1(0, SHARES)] * 3, 3, id="fseq 0"),
        pytest.param(
            [bundle(message(CUR, "alive", *SHARES), *sets(*SHARES))] * 3, 2, id="no fseq, known from the second on"
        ),
        pytest.param([*split(1), *split(2)], 3, id="one fseq over several datagrams"),
        pytest.param([tuio1(1, {}), *of_type("f", 3)[1:]], 3, id="source now and then"),
        pytest.param([bundle(bundle(bundle(*alone(1)), bundle()), bundle())], 1, id="bundles within bundles"),
        pytest.param([tuio1(1, dict.fromkeys(range(100, 140), (3.0, 3.0)) | SHARES)], 1, id="more than 31 alive"),
        pytest.param([profile("/tuio/25Dcur", 0.0, 0.0, 0.0, 0.0, 0.0)], 1, id="25Dcur"),
        pytest.param([profile("/tuio/2Dblb", *[0.1] * 9)], 1, id="2Dblb"),
        pytest.param(
            [profile("/tuio/2Dobj", 0.0), tuio1(1, SHARES), profile("/tuio/2Dblb", *[0.1] * 9)], 1, id="cursors first"
        ),
        pytest.param([bounds()], 1, id="bounds, 2.0"),
        pytest.param([bounds(tokens=(9,))], 1, id="bounds of a token are no finger, 2.0"),
    ],
)
def test_frames_of_each_kind_of_sender_have_their_contacts(datagrams: list[bytes], frames: int) -> None:
    found = received(Decoder(PAD), *datagrams, period_ms=1)
    assert len(found) == frames
    assert places(found[-1]) == PLACED
    assert all(one.touching for one in found[-1].contacts)


def test_sixty_four_bit_ids_stay_apart() -> None:
    ids = ((1 << 62) + 5, (1 << 62) + 6, -(1 << 63))
    (frame,) = received(
        Decoder(PAD),
        bundle(
            message(CUR, "alive", *ids, kinds="shhh"),
            *[message(CUR, "set", one, 0.5, 0.5, kinds="sh") for one in ids],
            message(CUR, "fseq", 1 << 40, kinds="sh"),
        ),
    )
    assert len({one.contact_id for one in frame.contacts}) == 3
    assert all(abs(one.contact_id) < 1 << 53 for one in frame.contacts)


def test_datagrams_of_one_number_are_one_frame_with_one_instant() -> None:
    first, rest, second, third = received(Decoder(PAD), *split(1), *split(2), *split(3), period_ms=1)
    assert [places(one) for one in (first, rest, second, third)] == [{7: (0.0, 0.0)}, PLACED, PLACED, PLACED]
    assert (first.t_ns, rest.t_ns, second.t_ns, third.t_ns) == (0, 0, 2 * MS, 4 * MS)


@pytest.mark.parametrize("height", [0.5, math.nan])
def test_a_cursor_above_the_surface_does_not_touch_it(height: float) -> None:
    decoder = Decoder(PAD)
    (frame,) = received(decoder, profile("/tuio/25Dcur", height))
    assert not any(one.touching for one in frame.contacts)
    assert decoder.counters["hovering"] == 2


@pytest.mark.parametrize(
    ("datagrams", "counted"),
    [
        ([*alone(1, end=False), *alone(1, end=False)], "unended"),
        ([profile("/tuio/2Dobj", 0.0)], "other_profiles"),
        ([bundle(message(CUR, "set", "x", 0.5, 0.5), message(CUR, "set", 1, "x"))], "outside"),
        ([tuio1(1, {1: (640.0, 480.0)})], "outside"),
    ],
)
def test_what_cannot_be_taken_is_counted_and_is_no_contact(datagrams: list[bytes], counted: str) -> None:
    decoder = Decoder(PAD)
    assert not any(frame.contacts for frame in received(decoder, *datagrams))
    assert decoder.counters[counted] > 0


def test_a_clock_of_the_tracker_that_stands_still_is_not_used() -> None:
    t_ns = 3_900_000_000 * 1_000_000_000
    frames = received(Decoder(PAD), *[tuio2(number, t_ns, {1: (0.1 * number, 0.5)}) for number in (1, 2, 3)])
    assert [frame.t_ns for frame in frames] == [0, 10 * MS, 20 * MS]


def test_another_source_is_refused_before_its_messages_are_decoded() -> None:
    decoder = Decoder(PAD)
    received(decoder, tuio1(1, SHARES))
    torn = message(CUR, "set", 1, 0.5, 0.5, 0.0, 0.0, 0.0)[:-8]
    for source, reason in (("other", "foreign"), ("tracker", "length")):
        before = decoder.counters[reason]
        assert received(decoder, bundle(torn, message(CUR, "source", source), message(CUR, "fseq", 2))) == []
        assert decoder.counters[reason] == before + 1


def test_what_no_tracker_sends_is_left_out_and_bounded() -> None:
    long = [0.5] * 200
    frames = [
        *received(Decoder(PAD), bundle(*alone(1)[:2], message(CUR, "set", 7, *long), message(CUR, "fseq", 1))),
        *received(Decoder(PAD), bundle(message("/tuio2/frm", 1, 0), message("/tuio2/ptr", 7, *long))),
    ]
    assert [frame.contacts for frame in frames] == [()] * len(frames)
    decoder, tokens = Decoder(PAD), 0
    for frame in range(1, 1 + 2 * osc.MAX_ARGUMENTS // 40):
        numbers = range(40 * frame, 40 * (frame + 1))
        tokens += len(numbers)
        sent = [message("/tuio2/tok", number, 0, 0, 0.5, 0.5, 0.0) for number in numbers]
        received(decoder, bundle(message("/tuio2/frm", frame, 0), *sent))
    assert decoder.counters["other_profiles"] == tokens
    many = [
        bundle(
            *[message(CUR, "set", 100 * part + n, 0.5, 0.5, 0.0, 0.0, 0.0) for n in range(60)], message(CUR, "fseq", 7)
        )
        for part in range(4 * osc.MAX_MESSAGES // 60)
    ]
    assert all(len(frame.contacts) <= 256 for frame in received(Decoder(PAD), *many, period_ms=0))
