"""Every command of the session has its message, and only its own."""

from __future__ import annotations

from typing import get_args

import pytest

from hapticd.core.limits import silence
from hapticd.values import (
    BoardCommand,
    ClearFault,
    HelloRequest,
    KeepAlive,
    ReferenceFrame,
    SelectController,
    TimeRequest,
)
from hapticd.wire import board_messages, protocol
from hapticd.wire.commands import encode
from hapticd.wire.framing import FrameSplitter

COMMANDS: dict[int, BoardCommand] = {
    protocol.MSG_HELLO_REQUEST: HelloRequest(),
    protocol.MSG_REFERENCE: ReferenceFrame(7, 2**32 - 5, silence(0, 2)),
    protocol.MSG_KEEPALIVE: KeepAlive(0xFFFF),
    protocol.MSG_TIME_REQUEST: TimeRequest(2**63),
    protocol.MSG_CLEAR_FAULT: ClearFault(),
    protocol.MSG_SET_CONTROLLER: SelectController("pi_ff"),
}


def test_the_table_holds_every_command_there_is() -> None:
    assert {type(command) for command in COMMANDS.values()} == set(get_args(BoardCommand))


@pytest.mark.parametrize(("message_type", "command"), COMMANDS.items(), ids=lambda value: type(value).__name__)
def test_a_command_is_one_whole_frame_of_its_type(message_type: int, command: BoardCommand) -> None:
    (message,) = FrameSplitter(board_messages.FRAME_MAX).feed(encode(command))
    assert message[0] == message_type


def test_fields_arrive_as_they_were_given() -> None:
    def payload(command: BoardCommand) -> bytes:
        (message,) = FrameSplitter(board_messages.FRAME_MAX).feed(encode(command))
        return message[1:]

    assert protocol.KEEPALIVE.unpack(payload(KeepAlive(513))) == (513,)
    assert protocol.TIME_REQUEST.unpack(payload(TimeRequest(10**18))) == (10**18,)
    assert protocol.SET_CONTROLLER.unpack(payload(SelectController("pi"))) == (protocol.LAWS["pi"], 0.0, 0.0)
    assert protocol.REFERENCE.unpack_from(payload(ReferenceFrame(9, 123, silence(0, 3)))) == (9, 123, 1, 3)


def test_an_unknown_controller_is_refused_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="no controller 'pid'"):
        encode(SelectController("pid"))
