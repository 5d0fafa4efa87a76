"""The trackpad decoder against the Linux driver's own results, hostile bytes and awkward clocks."""

from __future__ import annotations

import functools
import json
import math
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from datagrams import tuio1
from hypothesis import example, given, settings
from hypothesis import strategies as st
from input_events import END, SCREEN, axis, packed

from hapticd.values import AffineMap, Contact
from hapticd.wire.trackpad import PADS, Decoder, Pad, PadGeometry, from_fields, to_fields, tuio
from hapticd.wire.trackpad.evdev import EV_SYN, POSITION_X, POSITION_Y, SYN_MT_REPORT

WRAP_MS = 1 << 21
MS = 1_000_000
GOLDEN_FILE = Path(__file__).parents[1] / "data/trackpad-golden.jsonl"
GOLDEN = [
    pytest.param(record, id=f"line{number}-{record['tag']}")
    for number, line in enumerate(GOLDEN_FILE.read_text().splitlines(), 1)
    if "report" in (record := json.loads(line))
]
MODEL_OF_TAG = {"mt2-bt": "mt2-bt", "mt2-usb": "mt2-usb", "mt1-bt": "mt1"}
ORIENTATIONS = {"mt2-bt": 8, "mt2-usb": 8, "mt1-bt": 64}


def mt2_record(contact_id: int = 1, x: int = 0, y: int = 0, state: int = 4, orientation: int = 4) -> bytes:
    word = x & 0x1FFF | (y & 0x1FFF) << 13 | 2 << 26 | state << 29
    return struct.pack("<I5B", word, 98, 85, 60, 28, contact_id | orientation << 5)


def mt2_bt(*records: bytes, stamp_ms: int = 0, button: int = 0) -> bytes:
    header = (0x31, button | stamp_ms << 3 & 0xF8, stamp_ms >> 5 & 0xFF, stamp_ms >> 13 & 0xFF)
    return bytes(header) + b"".join(records)


def mt1(*records: bytes, button: int = 0) -> bytes:
    return bytes((0x28, button, 0, 0)) + b"".join(records)


def wrapped(model: str, bluetooth_report: bytes) -> bytes:
    prefix = bytes((2, bluetooth_report[1] & 1, 0, 0, 0, 0, 0, 1))
    return prefix + bluetooth_report if model.endswith("-usb") else bluetooth_report


def one_contact(model: str, x: int, y: int) -> bytes:
    return mt1(mt1_record(x=x, y=y)) if model == "mt1" else wrapped(model, mt2_bt(mt2_record(x=x, y=y)))


def mt1_record(contact_id: int = 1, x: int = 0, y: int = 0, state: int = 4) -> bytes:
    word = x & 0x1FFF | (y & 0x1FFF) << 13
    return struct.pack("<I5B", word, 98, 85, 40 | (contact_id & 3) << 6, contact_id >> 2 | 32 << 2, state << 4)


@pytest.mark.parametrize("record", GOLDEN)
def test_reports_decode_as_by_the_linux_driver(record: dict) -> None:
    frame = Decoder(MODEL_OF_TAG[record["tag"]]).decode(bytes.fromhex(record["report"]), 0)[-1]
    codes = ORIENTATIONS[record["tag"]]
    mt1_has_none = record["tag"] == "mt1-bt"
    units_x, units_y = PADS[MODEL_OF_TAG[record["tag"]]].geometry.units_per_mm
    mm = 2 / (units_x + units_y)
    down = {
        str(c.contact_id): {
            "major4": round(c.major_mm / mm),
            "minor4": round(c.minor_mm / mm),
            # evdev counts clockwise from +y, a quarter turn being half the codes
            "orient": round((math.pi / 2 - c.angle_rad) / math.pi * codes),
            "x": c.raw_x,
            "y": -c.raw_y,
            "pressure": 0 if mt1_has_none else round(c.pressure_frac * 253),
        }
        for c in frame.contacts
        if c.touching
    }
    expected = {i: slot | {"pressure": min(slot["pressure"], 253)} for i, slot in record["slots"].items()}
    assert down == expected
    assert frame.button is bool(record["button"])


def test_a_pair_gives_two_frames_and_the_second_keeps_what_it_does_not_mention() -> None:
    first, second = mt1(mt1_record(3, x=10), mt1_record(7, x=20)), mt1(mt1_record(3, x=11), button=1)
    frames = Decoder("mt1").decode(bytes((0xF7, len(first))) + first + second, 10**9)
    assert [f.button for f in frames] == [False, True]
    assert [f.t_ns for f in frames] == [10**9 - 11_250_000, 10**9]
    assert [{c.contact_id: c.raw_x for c in f.contacts} for f in frames] == [{3: 10, 7: 20}, {3: 11, 7: 20}]
    assert all(c.touching for c in frames[1].contacts)


def test_a_pair_with_a_torn_second_half_moves_nothing() -> None:
    decoder = Decoder("mt1")
    first = mt1(mt1_record(3))
    assert decoder.decode(bytes((0xF7, len(first))) + first + first[:-1], 0) == ()
    assert decoder.decode(mt1(), 1)[0].contacts == ()
    assert decoder.counters["length"] == 1


def test_an_mt1_contact_ends_on_state_zero() -> None:
    decoder = Decoder("mt1")
    decoder.decode(mt1(mt1_record(3)), 0)
    (ending,) = decoder.decode(mt1(mt1_record(3, state=0)), 11 * MS)
    assert [(c.contact_id, c.touching) for c in ending.contacts] == [(3, False)]
    assert decoder.decode(mt1(), 22 * MS)[0].contacts == ()


def test_pressure_is_a_share_of_the_largest_raw_value() -> None:
    light, hard = mt2_record(), mt2_record()[:7] + b"\xff" + mt2_record()[8:]  # 255 is beyond the scale
    largest = mt1_record()[:6] + b"\x7f\x00\x40"
    reports = (("mt2-bt", mt2_bt(light)), ("mt2-bt", mt2_bt(hard)), ("mt1", mt1(largest)))
    fractions = [Decoder(model).decode(report, 0)[0].contacts[0].pressure_frac for model, report in reports]
    assert fractions == [pytest.approx(28 / 253), 1.0, 1.0]


def test_a_missing_mt1_contact_ends_after_100_ms() -> None:
    decoder = Decoder("mt1")
    decoder.decode(mt1(mt1_record(3), mt1_record(4)), 0)
    decoder.decode(mt1(mt1_record(4)), 60 * MS)
    assert [c.contact_id for c in decoder.decode(mt1(), 100 * MS)[0].contacts] == [3, 4]
    assert [c.contact_id for c in decoder.decode(mt1(), 101 * MS)[0].contacts] == [4]
    assert decoder.decode(mt1(), 161 * MS)[0].contacts == ()


@pytest.mark.parametrize("state", range(8))
def test_every_record_is_given_and_states_4_and_5_touch(state: int) -> None:
    (contact,) = Decoder("mt2-bt").decode(mt2_bt(mt2_record(state=state)), 0)[0].contacts
    assert (contact.state, contact.touching) == (state, state in (4, 5))


@pytest.mark.parametrize("model", PADS)
def test_the_middle_of_the_declared_range_is_the_origin_and_its_edges_half_the_size(model: str) -> None:
    pad = PADS[model].geometry

    def decoded(x: int, y: int) -> Contact:
        return Decoder(model).decode(one_contact(model, x, y), 0)[0].contacts[0]

    low, high = decoded(pad.x_min_raw, pad.y_min_raw), decoded(pad.x_max_raw, pad.y_max_raw)
    assert (high.x_mm, high.y_mm) == pytest.approx((pad.width_mm / 2, pad.height_mm / 2), abs=1e-9)
    assert (low.x_mm, low.y_mm) == pytest.approx((-pad.width_mm / 2, -pad.height_mm / 2), abs=1e-9)


@given(
    st.builds(
        AffineMap.from_placement,
        st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
        st.floats(-360, 360),
        st.tuples(st.floats(0.5, 2), st.floats(0.5, 2)),
    ),
    st.integers(-4096, 4095),
    st.integers(-2900, 2900),
    st.integers(0, 7),
)
@settings(max_examples=60)
def test_the_placement_moves_points_and_turns_ellipses_as_the_affine_map_does(
    affine: AffineMap, x: int, y: int, orientation: int
) -> None:
    report = mt2_bt(mt2_record(x=x, y=y, orientation=orientation))
    plain, placed = (Decoder("mt2-bt", a).decode(report, 0)[0].contacts[0] for a in (AffineMap(), affine))
    assert (placed.x_mm, placed.y_mm) == pytest.approx(affine.apply(plain.x_mm, plain.y_mm), abs=1e-9)
    linear = replace(affine, offset_x_mm=0.0, offset_y_mm=0.0)
    tip_x, tip_y = linear.apply(plain.major_mm * math.cos(plain.angle_rad), plain.major_mm * math.sin(plain.angle_rad))
    assert placed.major_mm == pytest.approx(math.hypot(tip_x, tip_y), abs=1e-9)
    assert tip_x * math.sin(placed.angle_rad) - tip_y * math.cos(placed.angle_rad) == pytest.approx(0, abs=1e-9)
    assert 0 <= placed.angle_rad < math.pi


def test_a_mouse_report_requests_the_enable_until_the_next_touch_frame() -> None:
    for model, touch in (("mt2-usb", wrapped("mt2-usb", mt2_bt())), ("mt2-bt", mt2_bt()), ("mt1", mt1())):
        decoder = Decoder(model)
        assert not decoder.needs_enable
        assert decoder.decode(bytes((2, 0, 3, 255)), 0) == ()
        assert decoder.needs_enable
        decoder.decode(b"\x90\x01\x50", 0)
        assert decoder.needs_enable
        assert len(decoder.decode(touch, 0)) == 1
        assert not decoder.needs_enable
        assert (decoder.counters["mouse"], decoder.counters["foreign"]) == (1, 1)


@pytest.mark.parametrize(
    ("model", "report", "reason"),
    [
        ("mt2-bt", b"", "length"),
        ("mt2-bt", b"\x31\x00\x00", "length"),
        ("mt2-bt", mt2_bt(mt2_record())[:-1], "length"),
        ("mt2-bt", mt2_bt(*[mt2_record(i) for i in range(16)]), "length"),
        ("mt2-bt", mt2_bt(mt2_record(4), mt2_record(4)), "duplicate_id"),
        ("mt2-bt", mt1(), "foreign"),
        ("mt2-usb", mt2_bt(), "foreign"),
        ("mt2-usb", bytes(12), "foreign"),
        ("mt2-usb", b"\x02" + bytes(11), "foreign"),
        ("mt2-usb", b"\x02" + bytes(10), "length"),
        ("mt1", b"\xf7\x04" + mt1() + mt2_bt(), "foreign"),
        ("mt1", b"\xf7\xff" + mt1() + mt1(), "length"),
        ("mt1", b"\xf7\x00" + mt1() + mt1(), "length"),
        ("mt1", b"\xf7\x06" + b"\xf7\x04" + mt1() + mt1(), "foreign"),
    ],
)
def test_what_is_not_a_whole_report_is_refused_and_counted(model: str, report: bytes, reason: str) -> None:
    decoder = Decoder(model)
    assert decoder.decode(report, 0) == ()
    assert decoder.counters == dict.fromkeys(decoder.counters, 0) | {reason: 1}


def on_screen(x: int, y: int) -> bytes:
    """The only contact, in protocol A."""
    events = [axis(POSITION_X, x), axis(POSITION_Y, -y), (EV_SYN, SYN_MT_REPORT, 0), END]
    return packed(0, *events)


@pytest.mark.parametrize(
    ("pad", "report"),
    [
        *((PADS[model], functools.partial(one_contact, model)) for model in PADS),
        (SCREEN, on_screen),
        (tuio.surface(400.0, 200.0), lambda x, y: tuio1(1, {1: (x / tuio.SPAN_RAW, -y / tuio.SPAN_RAW)})),
    ],
)
def test_a_contact_beyond_the_pad_is_none_and_counted(pad: Pad, report: Callable[[int, int], bytes]) -> None:
    size, decoder = pad.geometry, Decoder(pad)
    width, height = size.x_max_raw - size.x_min_raw, size.y_max_raw - size.y_min_raw
    middle_x, middle_y = size.x_min_raw + width // 2, size.y_min_raw + height // 2
    near = [(size.x_min_raw - width // 20, middle_y), (middle_x, size.y_max_raw + height // 20)]
    far = [(middle_x, size.y_max_raw + height // 8), (middle_x, size.y_min_raw - height // 8)]
    if pad is SCREEN:
        far += [(-(1 << 31), middle_y), ((1 << 31) - 1, middle_y)]
    assert [len(Decoder(pad).decode(report(*place), 0)[0].contacts) for place in near] == [1] * len(near)
    assert [
        len(frame.contacts) for n, place in enumerate(far) for frame in decoder.decode(report(*place), n << 32)
    ] == [*[0] * len(far)]
    assert decoder.counters["off_pad"] == len(far)


def test_an_unknown_model_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(ValueError, match=r"'mt3'.*usbc-usb, mt2-usb, usbc-bt, mt2-bt, mt1"):
        Decoder("mt3")


OPENED = replace(
    PADS["mt2-bt"],
    model="a screen",
    name="a screen",
    geometry=PadGeometry(-3000, 3000, -2000, 2000, 300.0, 100.0),
    period_ns=8_333_333,
    source="",
    ids=None,
    enable=b"",
)


def test_a_pad_whose_size_is_known_only_when_it_is_opened_is_decoded_by_that_size() -> None:
    (frame,) = Decoder(OPENED).decode(mt2_bt(mt2_record(x=3000, y=-1000)), 0)
    assert (frame.contacts[0].x_mm, frame.contacts[0].y_mm) == pytest.approx((150.0, -25.0))


@pytest.mark.parametrize("pad", [*PADS.values(), OPENED], ids=lambda pad: pad.model)
def test_a_pad_is_itself_again_from_its_fields(pad: Pad) -> None:
    assert from_fields(json.loads(json.dumps(to_fields(pad)))) == pad
    assert pad is OPENED or from_fields({"model": pad.model}) is pad


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"model": 1}, "must have a model"),
        ({"model": "x" * 101}, "must have a model"),
        ({"layout": "mt9"}, "mt2-usb, mt2-bt, mt1"),
        ({"layout": ["mt1"]}, "unknown layout"),
        ({"period_ns": 0}, "period_ns"),
        ({"period_ns": 1e9}, "period_ns"),
        ({"x_raw": [5, 5]}, "x_raw"),
        ({"x_raw": [0.5, 5]}, "x_raw"),
        ({"y_raw": [0, 1 << 40]}, "y_raw"),
        ({"size_mm": [math.nan, 1.0]}, "size_mm"),
        ({"size_mm": [10**400, 1.0]}, "size_mm"),
        ({"size_mm": [1.0]}, "size_mm"),
        ({"size_mm": None}, "size_mm"),
        ({"quarter_turn_raw": -1}, "quarter_turn_raw"),
        ({"pressure_max_raw": 1.5}, "pressure_max_raw"),
    ],
)
def test_what_is_no_pad_is_one_sentence(change: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        from_fields(to_fields(OPENED) | change)


# --- the device's clock -------------------------------------------------------------------------------------------


def stamps_ns(stamps: list[tuple[int, int]]) -> tuple[list[int], Decoder]:
    """Frame times for pairs of device ms (not wrapped) and host ns."""
    decoder = Decoder("mt2-bt")
    return [decoder.decode(mt2_bt(stamp_ms=ms % WRAP_MS), host)[0].t_ns for ms, host in stamps], decoder


@given(
    st.integers(0, WRAP_MS - 1),
    st.integers(0, 10**15),
    st.lists(st.tuples(st.integers(0, 30 * 86_400_000), st.integers(-5, 700)), min_size=1, max_size=30),
    st.integers(-200, 200),
)
@example(WRAP_MS - 1, 0, [(11, 0), (WRAP_MS, 0), (3 * WRAP_MS + WRAP_MS // 2, 0), (11, 0)], 0)
@settings(max_examples=60)
def test_frame_times_follow_the_device_over_wraps_idle_gaps_drift_and_late_arrivals(
    start_ms: int, host_ns: int, steps: list[tuple[int, int]], drift_ppm: int
) -> None:
    device_ms, true_host_ns = start_ms, host_ns
    stamps = [(device_ms, host_ns)]
    for step_ms, late_ms in steps:
        step_ms = max(step_ms, 11)
        device_ms += step_ms
        true_host_ns += step_ms * MS - step_ms * drift_ppm
        stamps.append((device_ms, true_host_ns + late_ms * MS))
    times, decoder = stamps_ns(stamps)
    assert [t - host_ns for t in times] == [(ms - start_ms) * MS for ms, _ in stamps]
    assert decoder.counters["clock_steps"] == 0


@pytest.mark.parametrize(
    ("device_ms", "host_ms", "frame_ms"),
    [
        ((500_000, 500_011, 0, 11), (0, 11, 22, 33), [0, 11, 22, 33]),  # restarted
        ((5000, 5011, 5000, 4500, 4511), (0, 11, 12, 22, 33), [0, 11, 0, 22, 33]),  # jumped back
    ],
)
def test_a_clock_that_jumps_back_is_anchored_again_a_late_report_is_not(
    device_ms: tuple[int, ...], host_ms: tuple[int, ...], frame_ms: list[int]
) -> None:
    times, decoder = stamps_ns([(ms, host * MS) for ms, host in zip(device_ms, host_ms, strict=True)])
    assert times == [ms * MS for ms in frame_ms]
    assert decoder.counters["clock_steps"] == 1


STAMPS = st.integers(0, WRAP_MS - 1)


@given(STAMPS, st.lists(st.tuples(STAMPS, st.integers(0, 10**10)), max_size=40))
@settings(max_examples=60)
def test_a_device_clock_that_makes_no_sense_stays_near_the_hosts(first: int, rest: list[tuple[int, int]]) -> None:
    host_ns, stamps = 0, [(first, 0)]
    for stamp_ms, elapsed_ns in rest:
        host_ns += elapsed_ns
        stamps.append((stamp_ms, host_ns))
    times, _ = stamps_ns(stamps)
    bound_ns = 2_000 * MS + 2 * host_ns // 1000 + MS
    assert all(abs(t - host) <= bound_ns for t, (_, host) in zip(times, stamps, strict=True))


def test_a_stalled_device_clock_is_left_behind_after_two_seconds() -> None:
    times, decoder = stamps_ns([(1000, 11 * n * MS) for n in range(400)])
    assert max(11 * n * MS - t for n, t in enumerate(times)) < 2_020 * MS
    assert decoder.counters["clock_steps"] == 2


def test_after_a_reset_the_clock_begins_again_and_no_contact_is_kept() -> None:
    _, newer = stamps_ns([(WRAP_MS - 3, 123_456_789)])
    newer.reset()
    assert newer.decode(mt2_bt(stamp_ms=77), 999)[0].t_ns == 999
    decoder = Decoder("mt1")
    decoder.decode(mt1(mt1_record(3)), 0)
    decoder.reset()
    assert decoder.decode(mt1(), MS)[0].contacts == ()
