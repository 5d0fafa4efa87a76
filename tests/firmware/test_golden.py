"""One conversation with the board, byte for byte: `tests/data/board-golden.jsonl` holds it, C and Python replay it.

It begins just before the board's clock wraps. What the sensors say is given, so no law of control has a part in it.
After a wanted change `PYTHONPATH=tests python tests/firmware/test_golden.py` writes the file, and the examples in
the protocol's text.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from carrier_board import fake_measurement

from hapticd import board_protocol as protocol
from hapticd.board_protocol import (
    ClearFault,
    ControllerRequest,
    HelloRequest,
    Keepalive,
    LogRequest,
    RawVoltage,
    SetBaud,
    SetDrive,
    SetTelemetry,
    Stop,
    Sweep,
    TimeRequest,
)
from hapticd.board_values import ModeModel, ReferenceFrame, SetController, SetModel, SetWiring
from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.tools.firmware.text import plain
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire.commands import ALL_COMMANDS, encode
from hapticd.wire.device import Decoder
from hapticd.wire.framing import FrameSplitter, encode_frame

GOLDEN = Path(__file__).parents[1] / "data" / "board-golden.jsonl"
PROTOCOL_TEXT = Path(__file__).parents[2] / "firmware" / "PROTOCOL.md"
T_START_US = 2**32 - 1500
MEASURED_UM = np.array([0.25 - 0.5j, 1.0j])
DRIVE = SafeDrive(0, (Knot(0, (1 + 0j, -0.5 + 0j)), Knot(10_000_000, (1.25 + 0j, 0j))), LimitReason.NONE)
NAMES = {
    getattr(protocol, name): name.removeprefix("MSG_") for name in dir(protocol) if re.fullmatch(r"MSG_[A-Z_]+", name)
}

# What happens, in order: a command is received, ticks pass, or the sensors say something else.
SCRIPT: tuple[Any, ...] = (
    HelloRequest(),
    TimeRequest(123_456_789),
    SetController("pi"),
    SetController("pi", 800.0, 0.004),
    SetModel(1, ModeModel(180.5, 63.25, 5.75, 0.8 + 0.6j)),
    SetWiring(((1.0, 0.0), (0.0, -1.0)), ((1.0, 0.0), (0.0, -1.0)), ((0.0, 0.0), (0.0, 0.0))),
    SetDrive(29206.0, 50.0),
    SetDrive(29205.0, 120.0),
    SetBaud(3_000_000),
    ControllerRequest(),
    SetTelemetry(1000),
    4,
    SetTelemetry(0),
    ReferenceFrame(7, 1000, DRIVE),
    4,
    Keepalive(7),
    ReferenceFrame(8, 1000, DRIVE, has_pulse=True),
    4,
    Sweep(1, 29200.0, 29210.0, 2, 2, 12.5),
    20,
    Keepalive(0),
    20,
    Sweep(2, 29200.0, 29210.0, 2, 2, 12.5),
    RawVoltage(0, 3 - 4j, 50),
    4,
    Stop(),
    8,
    MEASURED_UM * np.nan,
    1,
    SetController("pi"),
    MEASURED_UM,
    LogRequest(),
    Sweep(1, 29200.0, 29210.0, 2, 2, 12.5),
    ClearFault(),
)


def new_board() -> Board:
    config = BoardConfig(
        w_limit_um=(4.0, 3.5),
        decay_1_s=(183.5, 183.75),
        detuning_rad_s=(-62.75, 62.75),
        gain_um_per_v_s=(5.25, 5.5),
        controller="pi",
        baud_max=3_000_000,
        image_crc=0x5EED1234,
    )
    gain = np.diag(config.gain_um_per_v_s)
    model = PlateModel(np.array(config.decay_1_s), np.array(config.detuning_rad_s), gain, np.eye(2), 0.0, 150.0)
    board = Board(model, config=config, boot_id=0x1234, t_start_us=T_START_US)
    fake_measurement(board, MEASURED_UM)
    return board


def received(board: Board) -> Iterator[dict[str, Any]]:
    """What the board wants to say, frame by frame."""
    while said := board.transmit():
        for line in said.split(b"\0")[:-1]:
            (message,) = Decoder().feed(line + b"\0")
            (raw,) = FrameSplitter(512).feed(line + b"\0")
            yield {"board": NAMES[raw[0]], "line": (line + b"\0").hex(), "value": plain(message)}


def run(board: Board, ticks: int) -> Iterator[dict[str, Any]]:
    """Runs the board; it is listened to as soon as it has something to say."""
    trace, done = BoardTrace(ticks, 2, 2), 0
    untouched = np.zeros((ticks, 0, 2)), np.zeros((ticks, 0))
    while done < ticks:
        done += board.run(ticks - done, *untouched, trace, done, stop_on_transmit=True)
        yield from received(board)


def conversation() -> Iterator[dict[str, Any]]:
    """The script played to the firmware's C, and all that is said on either side."""
    board = new_board()
    for step in SCRIPT:
        if isinstance(step, int):
            yield from run(board, step)
        elif isinstance(step, np.ndarray):
            fake_measurement(board, step)
        else:
            line = encode(step)
            yield {"host": type(step).__name__, "line": line.hex(), "value": plain(step)}
            board.receive(line)
            yield from received(board)


def golden() -> list[dict[str, Any]]:
    """The file's rows, the HELLO with today's hash and commands, which follow from protocol.h."""
    rows = [json.loads(row) for row in GOLDEN.read_text(encoding="utf-8").splitlines()]
    for row in rows:
        if row.get("board") == "HELLO":
            row["value"] |= {"protocol_hash": protocol.PROTOCOL_HASH, "commands": ALL_COMMANDS}
            message = bytearray(FrameSplitter(512).feed(bytes.fromhex(row["line"]))[0])
            struct.pack_into("<I", message, 3, protocol.PROTOCOL_HASH)
            struct.pack_into("<I", message, len(message) - 4, ALL_COMMANDS)
            row["line"] = encode_frame(bytes(message)).hex()
    return rows


def lines() -> list[bytes]:
    """All frames of the file."""
    return [bytes.fromhex(row["line"]) for row in golden()]


def test_host_and_board_say_what_they_said_when_the_file_was_written() -> None:
    said = list(conversation())
    for now, then in zip(said, golden(), strict=True):
        assert now == then


def test_every_message_of_the_protocol_is_said() -> None:
    assert {NAMES[FrameSplitter(512).feed(line)[0][0]] for line in lines()} == set(NAMES.values())


SHOWN = ("HELLO_REQUEST", "HELLO", "TIME_REQUEST", "TIME", "SET_CONTROLLER", "SET_MODEL", "REFERENCE", "STATUS")


def examples() -> str:
    """The first lines of a session's messages, as the protocol's text shows them."""
    first: dict[str, str] = {}
    for line in lines():
        (message,) = FrameSplitter(512).feed(line)
        first.setdefault(NAMES[message[0]], line.hex(" "))
    return "".join(f"{name:<14} {line}\n" for name, line in first.items() if name in SHOWN)


def test_the_examples_in_the_protocol_text_are_these_lines() -> None:
    assert f"```\n{examples()}```" in PROTOCOL_TEXT.read_text(encoding="utf-8")


def write() -> None:
    """The file and the examples in the protocol's text, as host and board speak now."""
    said = list(conversation())
    if said != golden():
        GOLDEN.write_text("".join(json.dumps(row) + "\n" for row in said), encoding="utf-8")
    before, rest = PROTOCOL_TEXT.read_text(encoding="utf-8").split("## Examples\n")
    lead, _, after = rest.split("```\n", 2)
    PROTOCOL_TEXT.write_text(f"{before}## Examples\n{lead}```\n{examples()}```\n{after}", encoding="utf-8")


if __name__ == "__main__":
    write()
