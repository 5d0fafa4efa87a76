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
from hapticd.wire import device
from hapticd.wire.commands import encode
from hapticd.wire.framing import FrameSplitter

COMMANDS: dict[int, BoardCommand] = {
    device.MSG_HELLO_REQUEST: HelloRequest(),
    device.MSG_REFERENCE: ReferenceFrame(7, 2**32 - 5, silence(0, 2)),
    device.MSG_KEEPALIVE: KeepAlive(0xFFFF),
    device.MSG_TIME_REQUEST: TimeRequest(2**63),
    device.MSG_CLEAR_FAULT: ClearFault(),
    device.MSG_SET_CONTROLLER: SelectController("pi_ff"),
}


def test_the_table_holds_every_command_there_is() -> None:
    assert {type(command) for command in COMMANDS.values()} == set(get_args(BoardCommand))


@pytest.mark.parametrize(("message_type", "command"), COMMANDS.items(), ids=lambda value: type(value).__name__)
def test_a_command_is_one_whole_frame_of_its_type(message_type: int, command: BoardCommand) -> None:
    (message,) = FrameSplitter(device.FRAME_MAX).feed(encode(command))
    assert message[0] == message_type


def test_fields_arrive_as_they_were_given() -> None:
    def payload(command: BoardCommand) -> bytes:
        (message,) = FrameSplitter(device.FRAME_MAX).feed(encode(command))
        return message[1:]

    assert device.KEEPALIVE.unpack(payload(KeepAlive(513))) == (513,)
    assert device.TIME_REQUEST.unpack(payload(TimeRequest(10**18))) == (10**18,)
    assert device.SET_CONTROLLER.unpack(payload(SelectController("pi"))) == (device.LAWS["pi"], 0.0, 0.0)
    assert device.REFERENCE.unpack_from(payload(ReferenceFrame(9, 123, silence(0, 3)))) == (9, 123, 1, 3)


def test_an_unknown_controller_is_refused_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="no controller 'pid'"):
        encode(SelectController("pid"))
