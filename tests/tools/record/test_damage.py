"""Recordings with damaged bytes, and MCAP files of other programs: what is whole is read, or one sentence."""

from __future__ import annotations

import random
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from hapticd.board_values import BoardCalibration
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import RecordingError
from hapticd.files.recording import mcap_writer
from hapticd.files.recording.header import Header
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import RecordingFile
from hapticd.wire.trackpad import DEFAULT_PAD

DATA = Path(__file__).parents[2] / "data"
RECORDS, IN_A_CHUNK = 1500, 50


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty chunks of records behind the header of a coarse map, which is read at once."""
    axis_mm, chance = np.linspace(-9.0, 9.0, 30), np.random.default_rng(1)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, np.ones((2, 30, 30)))
    header = Header("0", "", 0, True, 1, DEFAULT_PAD, Config(), modes, BoardCalibration())
    path = tmp_path_factory.mktemp("light") / "light.mcap"
    file = RecordingFile(path, header)
    for seq in range(RECORDS):
        file.add(Record("marker", seq, seq, {"client": "test", "text": chance.bytes(20).hex()}))
        if seq % IN_A_CHUNK == IN_A_CHUNK - 1:
            file.flush()
    file.close()
    return path


def bodies_of_chunks(path: Path) -> list[range]:
    """Where the packed bytes of each chunk are."""
    data, at, found = path.read_bytes(), 8, []
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == Opcode.CHUNK:
            found.append(range(at + 9 + 44, at + 9 + length))
        at += 9 + length
    return found


def test_a_damaged_chunk_is_lost_alone(light: Path, tmp_path: Path) -> None:
    records = list(open_recording(light).records())
    bodies, path, chance = bodies_of_chunks(light), tmp_path / "damaged.mcap", random.Random(1)
    assert len(records) == RECORDS
    for number, body in list(enumerate(bodies))[1::7]:
        data = bytearray(light.read_bytes())
        data[chance.choice(body)] ^= chance.randint(1, 255)
        path.write_bytes(data)
        recording, lost = open_recording(path), range((number - 1) * IN_A_CHUNK, number * IN_A_CHUNK)
        assert list(recording.records()) == [record for record in records if record.seq not in lost]
        assert recording.losses.skipped_bytes == 9 + 44 + len(body)


def test_damage_anywhere_gives_records_that_were_written_or_a_sentence(light: Path, tmp_path: Path) -> None:
    whole, records = light.read_bytes(), list(open_recording(light).records())
    path, readable = tmp_path / "damaged.mcap", 0
    for seed in range(50):
        data, chance = bytearray(whole), random.Random(seed)
        for _ in range(chance.randint(1, 8)):
            data[chance.randrange(len(data))] ^= chance.randint(1, 255)
        path.write_bytes(data)
        try:
            found = list(open_recording(path).records())
        except RecordingError:
            continue
        readable += 1
        assert all(records[record.seq] == record for record in found)
    assert readable > 10


@pytest.mark.parametrize("compression", CompressionType)
def test_a_recording_is_read_however_its_chunks_are_compressed(
    light: Path, compression: CompressionType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_writer, "COMPRESSION", compression)
    recording, path = open_recording(light), tmp_path / "packed.mcap"
    file = RecordingFile(path, recording.header)
    for record in recording.records():
        file.add(record)
    file.close()
    assert list(open_recording(path).records()) == list(recording.records())


def test_an_uncompressed_recording_of_an_earlier_hapticd_is_read() -> None:
    recording = open_recording(DATA / "recording-uncompressed.mcap")
    assert [record.fields["text"] for record in recording.records()] == ["x" * seq for seq in range(35)]
    assert not recording.losses.any
    assert recording.losses.skipped_bytes == 0


def test_a_chunk_that_claims_to_unpack_to_too_much_is_damaged(tmp_path: Path) -> None:
    import zstandard

    zeros = bytes(1 << 23)
    packed = zstandard.compress(zeros)
    path = tmp_path / "bomb.mcap"
    for claimed in (len(zeros), 9):  # also where the packed bytes alone say how many they are
        body = struct.pack("<QQQII", 0, 0, claimed, zlib.crc32(zeros), 4) + b"zstd"
        body += struct.pack("<Q", len(packed)) + packed
        path.write_bytes(b"\x89MCAP0\r\n" + (struct.pack("<BQ", 6, len(body)) + body) * 1000)
        with pytest.raises(RecordingError, match="is no recording of hapticd's"):
            open_recording(path)


@pytest.mark.parametrize("options", [{}, {"use_chunking": False}, {"compression": CompressionType.LZ4}])
@pytest.mark.parametrize(
    ("profile", "sentence"), [("ros2", "is no recording of hapticd's"), ("hapticd", "header is missing or damaged")]
)
def test_an_mcap_file_without_our_header_is_of_another_program_by_its_profile(
    options: dict[str, object], profile: str, sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, **options)  # type: ignore[arg-type]
        writer.start(profile=profile, library="other")
        writer.add_message(writer.register_channel("/tf", "cdr", 0), 1, b"\0\1\0\0", 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(RecordingError, match=sentence):
        open_recording(path)
