"""Recordings: RecordingError in one sentence, or records of the documented forms, whatever the bytes.

No fuzzer makes a file with a header by chance. So behind a first byte of 1 come messages for a sound file: each behind
the word `\xa5rec` and the number of its kind. Behind a 0 comes a whole file, whose chunks need no checksum.
"""

from __future__ import annotations

from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from fuzz.files import in_file
from fuzz.target import Cost, Target
from hapticd.board_values import BoardCalibration
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import RecordingError
from hapticd.files.recording.header import Header, header_fields
from hapticd.files.recording.kinds import HEADER, KINDS, encode, fits
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.tools.record.tables import tables
from hapticd.wire.trackpad import DEFAULT_PAD

WORD = b"\xa5rec"
NAMES = tuple(KINDS)
MAX_ROWS_PER_BYTE = 2

Messages = list[tuple[str, bytes]]


def check(data: bytes) -> bool:
    return in_file("recording.mcap", read, RecordingError, framed(data[1:]) if data[:1] == b"\1" else data[1:])


def framed(data: bytes) -> bytes:
    """A file of the messages between the words, with the least header in front."""
    parts = [part for part in data.split(WORD)[1:] if part]
    return mcap([(NAMES[part[0] % len(NAMES)], part[1:]) for part in parts])


def mcap(messages: Messages) -> bytes:
    """A file of these messages, made by the library alone."""
    file = BytesIO()
    writer = McapWriter(file, compression=CompressionType.NONE, enable_crcs=False)
    writer.start()
    used = [HEADER, *dict.fromkeys(kind for kind, _ in messages if kind != HEADER)]
    channels = {name: writer.register_channel(KINDS[name].topic, KINDS[name].encoding, 0) for name in used}
    writer.add_message(channels[HEADER], 0, least_header(), 0)
    for number, (kind, data) in enumerate(messages):
        writer.add_message(channels[kind], 7 + number, data, 7, number)
    writer.finish()
    return file.getvalue()


def read(path: Path) -> None:
    """What is taken has its documented form, and can be put into tables."""
    recording = open_recording(path)
    for record in recording.records():
        assert fits(record.fields, KINDS[record.kind].form)
        assert type(record.t_ns) is int
    found = tables(recording)
    rows = sum(len(table["t_ns"]) for table in found.values())
    assert rows <= MAX_ROWS_PER_BYTE * path.stat().st_size


@cache
def least_header() -> bytes:
    axis_mm = np.linspace(-9.0, 9.0, 4)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, np.ones((2, 4, 4)))
    fields = header_fields(Header("0", "", 0, True, 1, DEFAULT_PAD, Config(), modes, BoardCalibration()))
    return encode(HEADER, fields | {"config_toml": ""})


TARGET = Target("record", check, Cost(10_000, 3_000_000), Cost(20, 40))
