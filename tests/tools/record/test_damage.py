"""Recordings with damaged bytes: all but the damaged chunks is read, whatever was hit, the header too."""

from __future__ import annotations

import random
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from hapticd.board_values import BoardCalibration
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import RecordingError
from hapticd.files.recording.header import Header
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import RecordingFile
from hapticd.wire.trackpad import DEFAULT_PAD

DATA = Path(__file__).parents[2] / "data"
FILES = 200


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty chunks of records behind the header of a coarse map, which is read at once."""
    axis_mm, chance = np.linspace(-9.0, 9.0, 30), np.random.default_rng(1)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, chance.normal(size=(2, 30, 30)))
    header = Header("0", "", 0, True, 1, DEFAULT_PAD, Config(), modes, BoardCalibration())
    path = tmp_path_factory.mktemp("light") / "light.mcap"
    file = RecordingFile(path, header)
    for seq in range(1500):
        file.add(Record("marker", seq, seq, {"client": "test", "text": chance.bytes(20).hex()}))
        if seq % 50 == 49:
            file.flush()
    file.close()
    return path


def chunks_of(path: Path) -> list[tuple[int, int]]:
    """Where each chunk begins and ends."""
    data, at, found = path.read_bytes(), 8, []
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 6:
            found.append((at, at + 9 + length))
        at += 9 + length
    return found


def damaged(data: bytes, chance: random.Random) -> tuple[bytes, list[int]]:
    """A copy with one to eight bytes, or short runs of them, changed; and the places."""
    copy, places = bytearray(data), []
    for _ in range(chance.randint(1, 8)):
        at = chance.randrange(len(data))
        for place in range(at, min(at + chance.choice((1, 1, 1, 16)), len(data))):
            copy[place] ^= chance.randint(1, 255)
            places.append(place)
    return bytes(copy), places


def test_damaged_bytes_lose_their_own_chunks_only(light: Path, tmp_path: Path) -> None:
    data, records = light.read_bytes(), {record.seq: record for record in open_recording(light).records()}
    chunks, path, readable, kept = chunks_of(light), tmp_path / "damaged.mcap", 0, 0
    headers = [(begin, end) for begin, end in chunks if end - begin == chunks[0][1] - chunks[0][0]]
    for seed in range(FILES):
        hurt, places = damaged(data, random.Random(seed))
        path.write_bytes(hurt)
        try:
            found = list(open_recording(path).records())
        except RecordingError:  # all copies of the header are hit, and of one the place where it begins
            assert all(any(begin <= place < end for place in places) for begin, end in headers)
            continue
        readable += 1
        assert all(records[record.seq] == record for record in found)
        is_hit = [any(begin <= place < end for place in places) for begin, end in chunks]
        if not any(is_hit):
            assert len(found) == len(records)
        kept += len(found)
    print(f"{readable} of {FILES} readable, {100.0 * kept / (FILES * len(records)):.1f} % of their records")
    assert readable >= 0.99 * FILES


def test_a_header_whose_copies_are_all_damaged_is_the_vote_of_them(light: Path, tmp_path: Path) -> None:
    data = bytearray(light.read_bytes())
    sizes = [end - begin for begin, end in chunks_of(light)]
    copies = [chunk for chunk, size in zip(chunks_of(light), sizes, strict=True) if size == sizes[0]]
    assert len(copies) >= 3
    for number, (begin, _) in enumerate(copies):
        data[begin + 1000 + 100 * number] ^= 0xFF
    path = tmp_path / "hurt.mcap"
    path.write_bytes(bytes(data))
    whole = open_recording(light)
    recording = open_recording(path)
    assert recording.header.config == whole.header.config
    assert list(recording.records()) == list(whole.records())


def test_an_uncompressed_recording_of_an_earlier_hapticd_is_read() -> None:
    recording = open_recording(DATA / "recording-uncompressed.mcap")
    assert [record.fields["text"] for record in recording.records()] == ["x" * seq for seq in range(35)]
    assert not recording.losses.any
    assert recording.losses.skipped_bytes == 0


def test_a_chunk_that_claims_to_unpack_to_too_much_is_damaged(tmp_path: Path) -> None:
    import zstandard

    zeros = bytes(1 << 23)
    packed = zstandard.compress(zeros)
    body = struct.pack("<QQQII", 0, 0, len(zeros), zlib.crc32(zeros), 4) + b"zstd"
    body += struct.pack("<Q", len(packed)) + packed
    path = tmp_path / "bomb.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + (struct.pack("<BQ", 6, len(body)) + body) * 1000)
    with pytest.raises(RecordingError, match=r"header is missing|does not begin as one"):
        open_recording(path)
