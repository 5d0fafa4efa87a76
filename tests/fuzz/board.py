"""Bytes from the board: in any pieces they give the same sound messages, and noise costs no more than it reaches."""

from __future__ import annotations

import cmath
import dataclasses
import json
import math

from fuzz.target import CORPORA, Cost, Target
from hapticd.board_protocol import Keepalive
from hapticd.wire.device import Decoder, encode
from hapticd.wire.framing import FrameSplitter, encode_frame

BUFFER_MAX = 512  # hapticd.wire.board_messages.FRAME_MAX, as FrameSplitter is given it


def check(data: bytes) -> None:
    """A byte for the size of the pieces, then the line."""
    line, size = data[1:], max(data[0] if data else 1, 1)
    whole, piecewise = Decoder(), Decoder()
    messages = whole.feed(line)
    pieces = [line[at : at + size] for at in range(0, len(line), size)]
    assert repr(tuple(m for piece in pieces for m in piecewise.feed(piece))) == repr(messages)
    assert piecewise.counters == whole.counters
    ends = line.count(0)
    assert len(messages) + sum(whole.counters.values()) <= ends
    assert len(piecewise._splitter._rest) <= BUFFER_MAX + 1  # by which one shows that it is too long
    for message in messages:
        for value in dataclasses.astuple(message) if dataclasses.is_dataclass(message) else message:
            check_finite(value)
    check_framing(line)


def check_finite(value: object) -> None:
    """Whatever a message holds, its numbers can be used."""
    if isinstance(value, (tuple, list)):
        for item in value:
            check_finite(item)
    elif isinstance(value, complex):
        assert cmath.isfinite(value)
    elif isinstance(value, float):
        assert math.isfinite(value)


def check_framing(message: bytes) -> None:
    """The same bytes as a message: framed and unframed, and heard after noise that is ended."""
    if message:
        assert FrameSplitter(2 * len(message) + 16).feed(encode_frame(message)) == [message]
    splitter = FrameSplitter(BUFFER_MAX)
    splitter.feed(message + b"\0")
    after = encode(Keepalive(7))
    assert splitter.feed(after) == FrameSplitter(BUFFER_MAX).feed(after)


def seeds() -> dict[str, bytes]:
    """A line of each kind of message in the golden conversation, and all of them."""
    lines: dict[str, bytes] = {}
    for row in map(json.loads, (CORPORA / "board-golden.jsonl").read_text(encoding="utf-8").splitlines()):
        if "board" in row:
            lines.setdefault(row["board"], bytes.fromhex(row["line"]))
    found = {name: b"\x07" + line for name, line in lines.items()}
    found["all"] = b"\xff" + b"".join(lines.values())
    found["cut"] = b"\x01" + b"".join(line[: len(line) // 2] + line for line in lines.values())
    return found


TARGET = Target(
    name="device",
    check=check,
    seeds=seeds,
    fixed=Cost(3000, 200_000),
    per_byte=Cost(100, 800),
)
