"""What the session wants said to the board, as bytes."""

from __future__ import annotations

from ..values import BoardCommand, ClearFault, HelloRequest, KeepAlive, ReferenceFrame, SelectController, TimeRequest
from .device import (
    encode_clear_fault,
    encode_hello_request,
    encode_keepalive,
    encode_reference,
    encode_set_controller,
    encode_time_request,
)


def encode(command: BoardCommand) -> bytes:
    """One command as a frame for the line."""
    match command:
        case ReferenceFrame(seq, t_apply_us, drive):
            return encode_reference(seq, drive, t_apply_us)
        case KeepAlive(seq):
            return encode_keepalive(seq)
        case TimeRequest(t_host_ns):
            return encode_time_request(t_host_ns)
        case SelectController(name):
            return encode_set_controller(name)
        case HelloRequest():
            return encode_hello_request()
        case ClearFault():
            return encode_clear_fault()
