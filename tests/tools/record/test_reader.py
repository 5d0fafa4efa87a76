"""Reading: all that is intact, nothing else, whatever happened to the file; and one sentence where nothing is."""

from __future__ import annotations

import math
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.errors import RecordingError
from hapticd.files.recording import framing
from hapticd.files.recording.framing import HEAD, MAGIC, SYNC, RawRecord, Scanner, frame
from hapticd.files.recording.header import decode_header, encode_header
from hapticd.files.recording.reader import open_recording
from hapticd.files.recording.records import KINDS, body_of, described, record_of
from hapticd.files.recording.wanted import payload_of
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.values import AmplitudeTarget, ClientTargets, FrictionTarget, GratingTarget, MapTarget, VirtualPath
from hapticd.wire.client import decode_targets

BODIES = st.lists(st.binary(max_size=60) | st.just(SYNC * 3) | st.just(frame(5, 9, b"within")), min_size=1, max_size=8)

SCALARS = st.none() | st.booleans() | st.integers(-5, 2**64 - 1) | st.floats() | st.text(max_size=3)
FIELDS = st.recursive(SCALARS | st.binary(max_size=3), lambda part: st.lists(part, max_size=10), max_leaves=30)


def scanned(data: bytes, piece: int = 1 << 20) -> list[RawRecord]:
    scanner = Scanner()
    found = [raw for start in range(0, len(data), piece) for raw in scanner.feed(data[start : start + piece])]
    return found + list(scanner.finish())


def framed(bodies: list[bytes]) -> list[bytes]:
    return [frame(1, seq, body) for seq, body in enumerate(bodies)]


@given(BODIES, st.integers(1, 50))
@settings(deadline=None, max_examples=60)
def test_pieces_of_any_size_give_the_same_records(bodies: list[bytes], piece: int) -> None:
    data = b"".join(framed(bodies))

    assert scanned(data, piece) == [RawRecord(1, seq, body) for seq, body in enumerate(bodies)]


@given(BODIES, st.data())
@settings(deadline=None, max_examples=100)
def test_a_file_cut_anywhere_gives_all_complete_records_before_it(bodies: list[bytes], data: st.DataObject) -> None:
    records = framed([body for body in bodies if SYNC not in body] or [b""])
    cut = data.draw(st.integers(0, sum(map(len, records))))
    ends = [sum(map(len, records[: count + 1])) for count in range(len(records))]

    found = scanned(b"".join(records)[:cut])

    assert [raw.seq for raw in found] == [seq for seq, end in enumerate(ends) if end <= cut]


@given(BODIES, st.data())
@settings(deadline=None, max_examples=100)
def test_a_damaged_byte_loses_its_own_record_alone(bodies: list[bytes], data: st.DataObject) -> None:
    records = framed([body for body in bodies if SYNC not in body] or [b""])
    struck = data.draw(st.integers(0, len(records) - 1))
    at = data.draw(st.integers(0, len(records[struck]) - 1).filter(lambda place: place != 5))  # a byte of no meaning
    damaged = bytearray(records[struck])
    damaged[at] ^= data.draw(st.integers(1, 255))

    found = scanned(b"".join([*records[:struck], bytes(damaged), *records[struck + 1 :]]))

    assert [raw.seq for raw in found] == [seq for seq in range(len(records)) if seq != struck]


def test_heads_within_heads_cost_no_more_than_is_stated() -> None:
    body = b"".join(HEAD.pack(SYNC, 1, framing._head_check(1, 0, 1 << 20), 0, 1 << 20, 0) for _ in range(200_000))

    with pytest.raises(RecordingError, match="damaged beyond reading"):
        scanned(body)


def test_a_body_that_no_reader_would_take_is_not_framed() -> None:
    with pytest.raises(RecordingError, match="cannot be kept"):
        frame(1, 0, bytes(framing.MAX_BODY_BYTES + 1))


# --- records and the header -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@given(FIELDS)
@settings(deadline=None, max_examples=30)
def test_a_body_is_of_its_kind_or_refused(kind: str, value: object) -> None:
    body = msgpack.packb([0, *value] if isinstance(value, list) else value)
    try:
        record = record_of(KINDS[kind].number, 1, body)
    except RecordingError:
        return
    assert record is not None
    assert len(record.fields) == len(KINDS[kind].names)


def test_a_newer_hapticds_records_are_passed_over() -> None:
    assert record_of(200, 1, b"\xc1") is None


def test_the_header_is_read_back_the_same(strokes: Path) -> None:
    header = open_recording(strokes).header
    again = decode_header(encode_header(header))

    assert again.config == header.config
    assert again.modes.shapes.tobytes() == header.modes.shapes.tobytes()
    assert (again.instance, again.t_start_ns, again.is_whole) == (header.instance, header.t_start_ns, True)


def test_the_header_names_every_kind_and_every_field(strokes: Path) -> None:
    raw = next(iter(Scanner().feed(strokes.read_bytes()[len(MAGIC) :])))
    table = msgpack.unpackb(raw.body)

    assert table["records"] == described()
    for names in (entry["fields"] for entry in table["records"].values()):
        assert names[0] == "t_ns"
    assert "[solver]" in table["config_toml"]
    assert set(table["units"]) == {"_ns", "_us", "_mm", "_um", "_v"}


def test_the_neighbouring_modes_are_in_the_header_to_the_last_bit_and_older_ones_have_none(strokes: Path) -> None:
    known = GroundTruth().neighbours(3)  # the seed that it was recorded with
    header = open_recording(strokes).header
    read = header.neighbours
    assert read is not None
    assert np.array_equal(read.modes.shapes, known.modes.shapes)
    for name in ("decay_1_s", "detuning_rad_s", "finger_decay_1_s"):
        assert getattr(read, name) == getattr(known, name)
    table = msgpack.unpackb(encode_header(header))
    bad = table["neighbours"] | {"detuning_rad_s": [math.nan, 1.0]}
    with pytest.raises(RecordingError, match="header is not readable"):
        decode_header(msgpack.packb(table | {"neighbours": bad}))
    del table["neighbours"]
    assert decode_header(msgpack.packb(table)).neighbours is None


@pytest.mark.parametrize(
    "change",
    [
        {"format": 2},
        {"format": None},
        {"config_toml": "[solver]\nfade = -1\n"},
        {"config_toml": "x" * 70_000},
        {"config_toml": "[limits]\nw_limit_um = [4.0]\n"},
        {"modes_float64_le": {}},
        {"modes_float64_le": {"x_mm": b"1234567", "y_mm": bytes(8), "shapes_mode_y_x": b""}},
        {"calibration": [{"mode": 9}]},
        {"neighbours": {"modes_float64_le": {}}},
        {"neighbours": 7},
        {"instance": 2**63},
        {"is_whole": 1},
        {"hapticd": None},
    ],
)
def test_a_bad_header_is_one_sentence(strokes: Path, change: dict[str, object]) -> None:
    raw = next(iter(Scanner().feed(strokes.read_bytes()[len(MAGIC) :])))

    with pytest.raises(RecordingError) as refused:
        decode_header(msgpack.packb(msgpack.unpackb(raw.body) | change))
    assert str(refused.value).endswith(".")


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "does not begin as one"),
        (b"text", "does not begin as one"),
        (MAGIC, "header is missing"),
        (MAGIC + frame(2, 0, msgpack.packb([1])), "header is missing"),
        (MAGIC + frame(0, 0, b"\xc1"), "header is not readable"),
    ],
)
def test_what_is_no_recording_is_one_sentence_that_names_the_file(tmp_path: Path, data: bytes, sentence: str) -> None:
    path = tmp_path / "bad.hrec"
    path.write_bytes(data)

    with pytest.raises(RecordingError, match=sentence) as refused:
        open_recording(path)
    assert str(path) in str(refused.value)


def test_a_missing_file_and_parts_of_different_recordings_are_refused(strokes: Path, eventful: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        open_recording(strokes.with_name("nowhere.hrec"))
    with pytest.raises(RecordingError, match="is no part of the recording"):
        open_recording([strokes, eventful])


def test_losses_are_counted(tmp_path: Path, strokes: Path) -> None:
    data = bytearray(strokes.read_bytes())
    at = data.index(SYNC, len(data) // 2)
    data[at + HEAD.size] ^= 0xFF
    path = tmp_path / "struck.hrec"
    path.write_bytes(bytes(data))
    recording, whole = open_recording(path), open_recording(strokes)

    assert sum(1 for _ in recording.records()) == sum(1 for _ in whole.records()) - 1
    assert (recording.losses.missing, recording.losses.gaps) == (1, 1)
    assert recording.losses.any
    assert "1 records are missing in 1 places" in recording.losses.told()
    assert not whole.losses.any


# --- what simulated clients say --------------------------------------------------------------------------------------


def test_values_become_the_message_that_means_the_same() -> None:
    message = ClientTargets(
        "scenario",
        500_000_000,
        {
            1: AmplitudeTarget(1.5),
            2: FrictionTarget(0.25),
            3: GratingTarget(6.0, -0.3, 0.1, 1.9, 0.5),
            4: MapTarget(2, 1, b"\0\xff", 0.0, 2.0),
            "walker": AmplitudeTarget(0.0),
        },
        {"walker": VirtualPath(((1.0, math.pi), (-3.25, 0.1)), 77.7, loop=False)},
        stamp=2**63 - 1,
    )

    assert decode_targets(payload_of(message)) == message


def test_the_body_of_every_kind_that_a_machine_tells_is_read_back(eventful: Path) -> None:
    kinds = {record.kind for record in open_recording(eventful).records()}

    assert kinds == set(KINDS) - {"truth"}
    assert record_of(KINDS["timer"].number, 7, body_of("timer", 5, ())) == ("timer", 7, (5,))
