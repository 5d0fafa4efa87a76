"""Every command has its message, within the bounds that firmware/core/protocol.h gives its fields."""

from __future__ import annotations

import dataclasses
import math

import pytest

from hapticd import board_protocol as protocol
from hapticd.board_protocol import (
    ClearFault,
    ControllerRequest,
    HelloRequest,
    Keepalive,
    LogRequest,
    PlainCommand,
    RawVoltage,
    SetBaud,
    SetDrive,
    SetTelemetry,
    Stop,
    Sweep,
    TimeRequest,
)
from hapticd.board_values import (
    BoardCommand,
    ModeModel,
    ReferenceFrame,
    SetController,
    SetModel,
    SetWiring,
)
from hapticd.core.trajectory.gate import silence
from hapticd.wire import board_messages
from hapticd.wire.commands import encode
from hapticd.wire.framing import FrameSplitter

COMMANDS: tuple[BoardCommand, ...] = (
    HelloRequest(),
    ReferenceFrame(7, 2**32 - 5, silence(0, 2)),
    Keepalive(0xFFFF),
    TimeRequest(2**63),
    ClearFault(),
    SetController("pi_ff"),
    SetController("pi", 800.0, 0.004),
    SetModel(1, ModeModel(180.0, -60.0, 5.0, 1j)),
    SetTelemetry(500),
    SetWiring(((1.0, 1.0), (1.0, -1.0)), ((1j, 0.5), (0.5, 1.0)), ((0.01j, 0.0),) * 2),
    SetDrive(29210.0, 50.0),
    SetBaud(3_000_000),
    ControllerRequest(),
    Sweep(1, 29190.0, 29220.0, 31, 40, 20.0),
    RawVoltage(0, 3 - 4j, 100),
    LogRequest(),
    Stop(),
)
BOUNDED = [
    (command, name, end)
    for command in COMMANDS
    for name, bounds in getattr(command, "bounds", {}).items()
    for end in bounds
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda value: type(value).__name__)
def test_a_command_is_one_whole_frame_of_its_type(command: BoardCommand) -> None:
    (message,) = FrameSplitter(board_messages.FRAME_MAX).feed(encode(command))
    assert message[0] == (protocol.MSG_REFERENCE if isinstance(command, ReferenceFrame) else command.kind)


@pytest.mark.parametrize(("command", "name", "end"), BOUNDED)
def test_a_commands_fields_are_taken_at_their_bounds_and_refused_beyond(
    command: PlainCommand, name: str, end: float
) -> None:
    kind = type(getattr(command, name))
    encode(dataclasses.replace(command, **{name: kind(end)}))
    beyond = end + math.copysign(max(1.0, abs(end) * 1e-3), end - sum(command.bounds[name]) / 2.0)
    refused = rf"^(the magnitude of )?{name} is .*, not within .*\.$"
    if beyond >= 0.0 or kind is not complex:
        with pytest.raises(ValueError, match=refused):
            encode(dataclasses.replace(command, **{name: kind(beyond)}))
    with pytest.raises(ValueError, match=refused):
        encode(dataclasses.replace(command, **{name: math.nan}))


def test_an_unknown_controller_is_refused_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="no controller 'pid'"):
        encode(SetController("pid"))


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (SetController("pi", bandwidth_1_s=20001.0), "bandwidth_1_s is 20001, not within 10..20000"),
        (SetModel(0, ModeModel(float("nan"), 0.0, 5.0, 1j)), "decay_1_s is nan"),
        (SetModel(0, ModeModel(180.0, 0.0, 5.0, 0.9j)), "the magnitude of loop is 0.9"),
    ],
)
def test_what_no_board_would_take_is_not_encoded(command: BoardCommand, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        encode(command)
