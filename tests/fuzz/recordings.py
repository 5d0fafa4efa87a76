"""Recordings: RecordingError in one sentence, or records of the documented forms, whatever the bytes.

Checksums that no fuzzer guesses stand in every head: behind a first byte of 1 come bodies without them, each behind
the word `\xa5rec` and its kind.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import msgpack
import numpy as np

from fuzz.files import in_file
from fuzz.target import Cost, Target
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import RecordingError
from hapticd.files.recording.framing import MAGIC, MAX_BODY_BYTES, SYNC, frame
from hapticd.files.recording.header import FORMAT, Header, encode_header
from hapticd.files.recording.reader import open_recording
from hapticd.files.recording.records import HEARD, KINDS, body_of
from hapticd.tools.record.tables import tables
from hapticd.values import Finger, Knot, LimitReason, RawReport, SafeDrive, Tick, TouchPoint

MAX_ROWS_PER_BYTE = 2


def check(data: bytes) -> None:
    in_file("recording.hrec", framed(data[1:]) if data[:1] == b"\1" else data[1:], read, RecordingError)


def framed(data: bytes) -> bytes:
    """A file of the bodies between the words, with the least header in front."""
    parts = data.split(SYNC)[1:]
    return (
        MAGIC
        + frame(0, 0, least_header())
        + b"".join(frame(part[0], seq, part[1:]) for seq, part in enumerate(parts) if part)
    )


def read(path: Path) -> None:
    """What is taken has its documented form, and can be put into tables."""
    recording = open_recording(path)
    for record in recording.records():
        assert len(record.fields) == len(KINDS[record.kind].names)
        assert type(record.t_ns) is int
        assert (record.kind in HEARD) == (KINDS[record.kind].number <= 8)
    found = tables(recording)
    rows = sum(len(table["t_ns"]) for table in found.values())
    assert rows <= MAX_ROWS_PER_BYTE * path.stat().st_size


@cache
def least_header() -> bytes:
    axis_mm = np.linspace(-9.0, 9.0, 4)
    modes = ModeShapes.from_grid(axis_mm, axis_mm, np.ones((2, 4, 4)))
    body = encode_header(Header("0", "", 0, True, 1, "mt2-usb", Config(), modes, ()))
    table = msgpack.unpackb(body) | {"config_toml": "", "records": {}, "units": {}}
    assert table["format"] == FORMAT
    return bytes(msgpack.packb(table))


def seeds() -> dict[str, bytes]:
    point = TouchPoint("walker", 1.0, 2.0, 0.5, 0.5, 1.5, 2.5)
    drive = SafeDrive(5, (Knot(0, (1 + 0j, 0.5j)), Knot(9, (0j, 0j))), LimitReason.NONE)
    events: dict[str, tuple[object, ...]] = {
        "reports": ((RawReport(4, b"\x02ab"),),),
        "pass": (Tick(7, 2, 9, drive, (point,), False), "ACTIVE", (Finger(1, 3, 1.5, -2.5, False),)),
        "targets": (msgpack.packb({"v": 1, "levels": b"\0"}), "uid 7"),
        "written": (b"\0\x01", True),
        "truth": ([[1.0, 2.0], None], [0.0, None], [[1.0, 0.0]], [[0.1, 0.2], None]),
        "board_link": (True, "here"),
        "marker": ("study", "begin"),
    }
    bodies = {
        kind: SYNC + bytes((KINDS[kind].number,)) + body_of(kind, 7, values)  # type: ignore[arg-type]
        for kind, values in events.items()
    }
    whole = MAGIC + frame(0, 0, least_header()) + frame(KINDS["timer"].number, 0, body_of("timer", 3, ()))
    return {
        **{kind: b"\1" + body for kind, body in bodies.items()},
        "all": b"\1" + b"".join(bodies.values()),
        "whole": b"\0" + whole,
        "cut": b"\0" + whole[:-3],
        "struck": b"\0" + whole[:-3] + b"\0" + whole[-2:],
        "gap": b"\0" + whole + frame(KINDS["timer"].number, 9, body_of("timer", 4, ())),
        "text": b"\0not a recording",
        "deep": b"\1" + SYNC + b"\x20" + b"\x91" * 600,
    }


def extremes() -> dict[str, bytes]:
    start = MAGIC + frame(0, 0, least_header())
    long_claim = frame(2, 0, bytes(MAX_BODY_BYTES))[:20]
    timers = [frame(KINDS["timer"].number, seq, body_of("timer", seq, ())) for seq in range(20_000)]
    return {
        "heads": b"\0" + start + long_claim * 60_000,
        "syncs": b"\0" + start + SYNC * 100_000,
        "timers": b"\0" + start + b"".join(timers),
        "nils": b"\1" + SYNC + b"\x30" + msgpack.packb([0, [None] * 100_000, [None] * 100_000, [], [None] * 100_000]),
    }


TARGET = Target(
    name="record",
    check=check,
    seeds=seeds,
    fixed=Cost(10_000, 3_000_000),  # a reader's buffer, and the longest body
    per_byte=Cost(20, 40),
    extremes=extremes,
)
