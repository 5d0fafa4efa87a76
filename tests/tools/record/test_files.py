"""MCAP files of recordings: what is intact is read whatever happened to the rest, and nothing else is."""

from __future__ import annotations

import io
import json
import math
import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from hapticd.board_values import BoardCalibration
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import RecordingError
from hapticd.files.recording import mcap_writer
from hapticd.files.recording.header import FORMAT, Header, header_fields, header_from
from hapticd.files.recording.kinds import (
    HEADER,
    INPUTS,
    KINDS,
    MAX_MESSAGE_BYTES,
    TEXT,
    WHOLE,
    Maybe,
    Record,
    encode,
    fits,
    json_schema,
    pad_of,
)
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import RecordingFile
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.wire.trackpad import DEFAULT_PAD, PADS

from .conftest import written

DATA = Path(__file__).parents[2] / "data"
CHUNKS, IN_EACH = 5, 7  # of the small file
CHUNK_HEAD_BYTES = 9 + 40  # of an uncompressed chunk


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int]]:
    """A file of CHUNKS chunks with IN_EACH records and the least header, and where the header and each chunk end."""
    axis_mm = np.linspace(-9.0, 9.0, 4)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, np.ones((2, 4, 4)))
    path = tmp_path_factory.mktemp("small") / "small.mcap"
    with pytest.MonkeyPatch.context() as patched:  # so that a test finds what it damages
        patched.setattr(mcap_writer, "COMPRESSION", CompressionType.NONE)
        file = RecordingFile(path, Header("0", "", 0, True, 1, DEFAULT_PAD, Config(), modes, BoardCalibration()))
    ends = [path.stat().st_size]
    for seq in range(CHUNKS * IN_EACH):
        file.add(Record("marker", seq, seq, {"client": "test", "text": "x" * seq}))
        if (seq + 1) % IN_EACH == 0:
            file.flush()
            ends.append(path.stat().st_size)
    file.close()
    return path.read_bytes(), ends


@pytest.fixture
def sound(small: tuple[bytes, list[int]], tmp_path: Path) -> Path:
    """That file."""
    path = tmp_path / "small.mcap"
    path.write_bytes(small[0])
    return path


def test_a_reading_tells_how_much_of_its_files_is_read(sound: Path) -> None:
    shares: list[float] = []
    recording = open_recording([sound, sound])
    recording.progress = shares.append
    assert len(list(recording.records())) == 2 * CHUNKS * IN_EACH
    assert shares == sorted(shares)
    assert len({round(share, 3) for share in shares}) > 2 * CHUNKS
    assert 0.0 <= shares[0] < 0.3  # the header
    assert 0.8 < shares[-1] <= 1.0  # the index at the end is not read


# --- what happened to the file --------------------------------------------------------------------------------------


def test_a_file_cut_anywhere_gives_all_whole_chunks_before_the_cut(
    small: tuple[bytes, list[int]], tmp_path: Path
) -> None:
    whole, ends = small
    path = tmp_path / "cut.mcap"
    for cut in (*range(ends[0], len(whole), 89), *ends, *(end - 1 for end in ends[1:]), *(end + 1 for end in ends)):
        path.write_bytes(whole[:cut])
        recording = open_recording(path)
        found = [record.seq for record in recording.records()]
        whole_chunks = sum(end <= cut for end in ends[1:])

        assert found == list(range(len(found)))
        assert len(found) % IN_EACH == 0
        # The index of a chunk's messages follows it: a cut within that loses none of them.
        assert whole_chunks <= len(found) // IN_EACH <= whole_chunks + 1
        assert not recording.losses.any
        if cut < ends[-1] and len(found) // IN_EACH == whole_chunks:
            assert recording.losses.skipped_bytes == cut - ends[whole_chunks]


def test_a_file_cut_before_its_header_ends_is_one_sentence(small: tuple[bytes, list[int]], tmp_path: Path) -> None:
    whole, _ = small
    header_ends = whole.index(b"parasitic_modes\xc0")
    path = tmp_path / "headless.mcap"
    for cut in (*range(40), *range(40, header_ends, 397), header_ends):
        path.write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match=r"is no recording of hapticd's|header is missing"):
            open_recording(path)


def test_a_damaged_chunk_is_lost_alone(small: tuple[bytes, list[int]], tmp_path: Path) -> None:
    whole, ends = small
    path = tmp_path / "damaged.mcap"
    for number, begin in enumerate(ends[:-1]):
        data = bytearray(whole)
        data[begin + CHUNK_HEAD_BYTES + 30] ^= 1
        path.write_bytes(data)
        recording, lost = open_recording(path), range(number * IN_EACH, (number + 1) * IN_EACH)
        assert [one.seq for one in recording.records()] == [n for n in range(CHUNKS * IN_EACH) if n not in lost]
        assert recording.losses.skipped_bytes == 9 + int.from_bytes(whole[begin + 1 : begin + 9], "little")


@pytest.mark.parametrize("compression", CompressionType)
def test_a_recording_is_read_however_its_chunks_are_compressed(
    sound: Path, compression: CompressionType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_writer, "COMPRESSION", compression)
    recording = open_recording(sound)
    path = written(sound.with_name("packed.mcap"), recording.header, recording.records())
    assert list(open_recording(path).records()) == list(recording.records())


def test_an_uncompressed_recording_of_an_earlier_hapticd_is_read() -> None:
    recording = open_recording(DATA / "recording-uncompressed.mcap")
    assert [record.fields["text"] for record in recording.records()] == ["x" * seq for seq in range(35)]
    assert not recording.losses.any
    assert recording.losses.skipped_bytes == 0


def test_a_chunk_that_claims_to_unpack_to_too_much_is_damaged(tmp_path: Path) -> None:
    zeros = bytes(1 << 23)
    packed = zstandard.compress(zeros)
    path = tmp_path / "bomb.mcap"
    for claimed in (len(zeros), 9):  # also where the packed bytes alone say how many they are
        body = struct.pack("<QQQII", 0, 0, claimed, zlib.crc32(zeros), 4) + b"zstd"
        body += struct.pack("<Q", len(packed)) + packed
        path.write_bytes(b"\x89MCAP0\r\n" + (struct.pack("<BQ", 6, len(body)) + body) * 1000)
        with pytest.raises(RecordingError, match="is no recording of hapticd's"):
            open_recording(path)


# --- for other programs ---------------------------------------------------------------------------------------------


def test_other_programs_find_index_topics_schemas_and_metadata(eventful: Path) -> None:
    with eventful.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
        topics = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    assert summary is not None
    assert summary.statistics is not None
    assert {channel.topic for channel in summary.channels.values()} == {kind.topic for kind in KINDS.values()}
    assert sum(topics.values()) == summary.statistics.message_count
    assert topics["/header"] == 1
    assert topics["/pass"] > 50
    assert "[solver]" in metadata["hapticd"]["config_toml"]
    assert "_um: micrometres peak to peak" in metadata["hapticd"]["units"]
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count


def test_every_decision_is_json_with_the_schema_of_its_form(eventful: Path, strokes: Path) -> None:
    seen = set()
    for path in (eventful, strokes):
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                if channel.message_encoding == "json":
                    kind = next(kind for kind in KINDS.values() if kind.topic == channel.topic)
                    assert schema is not None
                    assert (schema.encoding, json.loads(schema.data)) == ("jsonschema", json_schema(kind.form))
                    assert fits(json.loads(message.data), kind.form), channel.topic
                    seen.add(channel.topic)
    of_other_devices = {KINDS[name].topic for name in ("stream", "samples")}  # test_inlets.py
    assert seen == {kind.topic for kind in KINDS.values() if kind.encoding == "json"} - of_other_devices
    assert {KINDS[name].encoding for name in (*INPUTS, "written")} == {"msgpack"}


def test_a_form_as_json_schema_has_its_members_and_which_are_required() -> None:
    assert json_schema({"n": WHOLE, "rows": Maybe([{"text": TEXT}])}) == {
        "type": "object",
        "properties": {
            "n": {"type": "integer"},
            "rows": {
                "type": "array",
                "items": {"type": "object", "properties": {"text": {"type": "string"}}, "required": ["text"]},
            },
        },
        "required": ["n"],
    }


# --- records and the header -----------------------------------------------------------------------------------------


def test_what_no_reader_would_take_is_left_out_and_missed(tmp_path: Path, header: Header) -> None:
    nan = {"fingers": [], "modal_um": {"d": [math.nan], "q": [0.0]}}
    long = {"payload": bytes(MAX_MESSAGE_BYTES), "user": ""}
    records = [Record("timer", 0, 0, {}), Record("truth", 1, 1, nan), Record("request", 2, 2, long)]
    path = written(tmp_path / "a.mcap", header, [*records, Record("timer", 3, 3, {})])
    recording = open_recording(path)

    assert [record.seq for record in recording.records()] == [0, 3]
    assert recording.losses.missing == 2


def test_the_header_is_read_back_to_the_last_bit(header: Header) -> None:
    again = header_from(msgpack.unpackb(encode(HEADER, header_fields(header))))
    known = GroundTruth().parasitic_modes(3)  # the seed that it was recorded with

    assert (again.config, again.pad) == (header.config, header.pad)
    assert again.modes.shapes.tobytes() == header.modes.shapes.tobytes()
    assert (again.instance, again.t_start_ns, again.is_whole) == (header.instance, header.t_start_ns, True)
    assert again.parasitic_modes is not None
    assert np.array_equal(again.parasitic_modes.modes.shapes, known.modes.shapes)
    for name in ("decay_1_s", "detuning_rad_s"):
        assert getattr(again.parasitic_modes, name) == getattr(known, name)


def test_an_earlier_recording_names_the_model_of_its_pad(header: Header) -> None:
    fields = header_fields(header)
    del fields["pad"]
    assert header_from(fields | {"trackpad_model": "mt1"}).pad is PADS["mt1"]
    gone = "rotation_deg = 90.0\nscale = [1.01, 0.99]\nmatrix = []\nsilence_ms = 40.0\n[gone]\nx = 1\n"
    turned = header_from(fields | {"trackpad_model": "mt1", "config_toml": f"[trackpad]\n{gone}"}).config.trackpad
    assert turned.matrix == pytest.approx((0.0, -0.99, 1.01, 0.0))
    with pytest.raises(RecordingError):
        header_from(fields | {"trackpad_model": "mt9"})
    assert pad_of({"is_up": True, "reason": "here", "model": "mt1"}) is PADS["mt1"]
    assert pad_of({"is_up": False, "reason": "gone"}) is None
    with pytest.raises(RecordingError, match=r"'mt9': use one of .*\.$"):
        pad_of({"is_up": True, "reason": "here", "model": "mt9"})


@pytest.mark.parametrize(
    "change",
    [
        {"format": FORMAT + 1},
        {"format": None},
        {"config_toml": "[solver]\ncontact_radius_mm = -1\n"},
        {"config_toml": "x" * 70_000},
        {"config_toml": "[limits]\nw_limit_um = [4.0]\n"},
        {"modes_float64_le": {}},
        {"modes_float64_le": {"x_mm": b"1234567", "y_mm": bytes(8), "shapes_mode_y_x": b""}},
        {"calibration": [{"mode": 9}]},
        {"parasitic_modes": {"modes_float64_le": {}}},
        {"parasitic_modes": 7},
        {"instance": 2**63},
        {"pad": 7},
        {"pad": {"model": "mt2-usb", "layout": "mt9"}},
        {"is_whole": 1},
        {"hapticd": None},
    ],
)
def test_a_bad_header_is_one_sentence(header: Header, change: dict[str, object]) -> None:
    with pytest.raises(RecordingError) as refused:
        header_from(header_fields(header) | change)
    assert str(refused.value).endswith(".")


def foreign(topic: str = "/a", data: bytes = b"{}", profile: str = "ros2", **options: Any) -> bytes:
    """The file of another program."""
    file = io.BytesIO()
    other = McapWriter(file, **options)
    other.start(profile=profile)
    other.add_message(other.register_channel(topic, "msgpack", 0), 1, data, 1)
    other.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "does not begin as one"),
        (b"text", "does not begin as one"),
        (foreign(), "names another program"),
        (foreign(use_chunking=False), "names another program"),
        (foreign(compression=CompressionType.LZ4), "names another program"),
        (foreign(profile="hapticd"), "header is missing or damaged"),
        (foreign("/header", b"\xc1"), "form of its kind"),
        (foreign("/header", b"\x80"), "header is not readable"),
        (None, "cannot be read"),
    ],
)
def test_what_is_no_recording_is_one_sentence_that_names_the_file(
    data: bytes | None, sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.mcap"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(RecordingError, match=sentence) as refused:
        open_recording(path)
    assert str(path) in str(refused.value)


def test_a_newer_hapticds_records_are_passed_over(
    tmp_path: Path, header: Header, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as newer:
        newer.setitem(KINDS, "news", KINDS["marker"]._replace(topic="/news"))
        records = [Record(kind, seq, seq, {"client": "", "text": ""}) for seq, kind in enumerate(("marker", "news"))]
        path = written(tmp_path / "newer.mcap", header, [*records, Record("timer", 2, 2, {})])
    recording = open_recording(path)

    assert [record.kind for record in recording.records()] == ["marker", "timer"]
    assert not recording.losses.any


# --- names and sizes ------------------------------------------------------------------------------------------------


def test_an_existing_recording_is_never_written_over(tmp_path: Path, header: Header) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    made = [RecordingFile(path, header) for _ in range(2)]
    for file in made:
        file.close()

    assert path.read_bytes() == b"precious"
    assert [file.path.name for file in made] == ["a-2.mcap", "a-3.mcap"]


@pytest.mark.parametrize(
    ("place", "sentence"),
    [(".", "is a folder"), ("/", "is a folder"), ("..", "is a folder"), ("/dev/null/a.mcap", "can be written there")],
)
def test_a_place_that_cannot_be_written_is_one_sentence(place: str, sentence: str, header: Header) -> None:
    with pytest.raises(RecordingError, match=sentence):
        RecordingFile(Path(place), header)


def fill(file: RecordingFile, records: int, *, in_chunk: int = 50) -> None:
    for seq in range(records):
        file.add(Record("timer", seq, seq, {}))
        if seq % in_chunk == 0:
            file.flush()
    file.close()


@pytest.fixture
def least_bytes(tmp_path_factory: pytest.TempPathFactory, header: Header) -> int:
    """Of a file that holds nothing but its header."""
    file = RecordingFile(tmp_path_factory.mktemp("least") / "a.mcap", header)
    file.close()
    return file.path.stat().st_size


def test_a_full_file_is_followed_and_the_oldest_is_removed(tmp_path: Path, header: Header, least_bytes: int) -> None:
    max_bytes = least_bytes + 40_000
    fill(RecordingFile(tmp_path / "a.mcap", header, max_bytes=max_bytes, max_files=3), 3000)
    kept = sorted(tmp_path.iterdir(), key=lambda path: int(path.stem.removeprefix("a-")))

    assert len(kept) == 3
    assert all(path.stat().st_size <= max_bytes for path in kept)
    recording = open_recording(kept)
    found = [record.seq for record in recording.records()]
    assert found == list(range(3000 - len(found), 3000))
    assert not recording.losses.any
    assert not recording.is_whole
    with pytest.raises(RecordingError, match="in their order"):
        list(open_recording([kept[0], kept[2], kept[1]]).records())


def test_a_file_that_may_not_be_followed_is_full_in_its_bounds(
    tmp_path: Path, header: Header, least_bytes: int
) -> None:
    path = tmp_path / "a.mcap"
    max_bytes = least_bytes + 30_000
    file = RecordingFile(path, header, max_bytes=max_bytes)
    with pytest.raises(RecordingError, match=r"reached record\.max_mb"):
        fill(file, 3000, in_chunk=1)
    file.close()

    assert path.stat().st_size <= max_bytes
    assert len(list(open_recording(path).records())) > 10
