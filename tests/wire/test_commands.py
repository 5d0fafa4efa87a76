"""Every command of the session has its message, and only its own."""

from __future__ import annotations

from typing import get_args

import pytest

from hapticd.board_values import (
    BoardCommand,
    ClearFault,
    ControllerRequest,
    HelloRequest,
    KeepAlive,
    LogRequest,
    ModeModel,
    RawVoltage,
    ReferenceFrame,
    SelectController,
    SetBaud,
    SetDrive,
    SetGains,
    SetModel,
    SetTelemetry,
    SetWiring,
    Stop,
    Sweep,
    TimeRequest,
    ToolCommand,
)
from hapticd.core.trajectory.gate import silence
from hapticd.wire import board_messages, protocol
from hapticd.wire.commands import encode
from hapticd.wire.framing import FrameSplitter

SESSION_COMMANDS: dict[int, BoardCommand] = {
    protocol.MSG_HELLO_REQUEST: HelloRequest(),
    protocol.MSG_REFERENCE: ReferenceFrame(7, 2**32 - 5, silence(0, 2)),
    protocol.MSG_KEEPALIVE: KeepAlive(0xFFFF),
    protocol.MSG_TIME_REQUEST: TimeRequest(2**63),
    protocol.MSG_CLEAR_FAULT: ClearFault(),
    protocol.MSG_SET_CONTROLLER: SelectController("pi_ff"),
    protocol.MSG_SET_MODEL: SetModel(1, ModeModel(180.0, -60.0, 5.0, 1j)),
    protocol.MSG_SET_TELEMETRY: SetTelemetry(500),
    protocol.MSG_SET_WIRING: SetWiring(((1.0, 1.0), (1.0, -1.0)), ((1j, 0.5), (0.5, 1.0)), ((0.01j, 0.0),) * 2),
    protocol.MSG_SET_DRIVE: SetDrive(29210.0, 50.0),
    protocol.MSG_SET_BAUD: SetBaud(3_000_000),
}
TOOL_COMMANDS: dict[int, ToolCommand] = {
    protocol.MSG_SET_CONTROLLER: SetGains("pi", 800.0, 0.004),
    protocol.MSG_CONTROLLER_REQUEST: ControllerRequest(),
    protocol.MSG_SWEEP: Sweep(1, 29190.0, 29220.0, 31, 40, 20.0),
    protocol.MSG_RAW_VOLTAGE: RawVoltage(0, 3 - 4j, 100),
    protocol.MSG_SET_TELEMETRY: SetTelemetry(500),
    protocol.MSG_LOG_REQUEST: LogRequest(),
    protocol.MSG_STOP: Stop(),
}


def test_the_tables_hold_every_command_there_is() -> None:
    assert {type(command) for command in SESSION_COMMANDS.values()} == set(get_args(BoardCommand))
    assert {type(command) for command in TOOL_COMMANDS.values()} == set(get_args(ToolCommand))


@pytest.mark.parametrize(
    ("message_type", "command"),
    [*SESSION_COMMANDS.items(), *TOOL_COMMANDS.items()],
    ids=lambda value: type(value).__name__,
)
def test_a_command_is_one_whole_frame_of_its_type(message_type: int, command: BoardCommand | ToolCommand) -> None:
    (message,) = FrameSplitter(board_messages.FRAME_MAX).feed(encode(command))
    assert message[0] == message_type


def test_an_unknown_controller_is_refused_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="no controller 'pid'"):
        encode(SelectController("pid"))


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (SetGains("pi", bandwidth_1_s=20001.0), "bandwidth_1_s is 20001, not within 10..20000"),
        (SetModel(0, ModeModel(float("nan"), 0.0, 5.0, 1j)), "decay_1_s is nan"),
        (SetModel(0, ModeModel(180.0, 0.0, 5.0, 0.9j)), "loop has the magnitude 0.9"),
        (Sweep(0, float("inf"), 29220.0, 31, 40, 20.0), "start_hz is inf"),
        (Sweep(0, 29190.0, 29220.0, 2002, 40, 20.0), "points is 2002, not within 1..2001"),
        (Sweep(0, 29190.0, 29220.0, 31, 0, 20.0), "dwell_ms is 0"),
        (Sweep(-1, 29190.0, 29220.0, 31, 40, 20.0), "mode is -1"),
        (RawVoltage(0, complex("nan"), 100), "magnitude is nan"),
        (RawVoltage(0, 1j, 1001), "duration_ms is 1001, not within 1..1000"),
        (SetTelemetry(65536), "rate_hz is 65536"),
    ],
)
def test_what_no_board_would_take_is_not_encoded(command: BoardCommand | ToolCommand, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        encode(command)
