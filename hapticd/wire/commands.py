"""Encoder of board commands: dispatches each command value to its function in `device`."""

from __future__ import annotations

from ..board_values import (
    BoardCommand,
    ClearFault,
    ControllerRequest,
    HelloRequest,
    KeepAlive,
    LogRequest,
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
from . import device


def encode(command: BoardCommand | ToolCommand) -> bytes:
    """Encode one command as a frame. Raises ValueError for values that no board accepts."""
    match command:
        case ReferenceFrame(seq, t_apply_us, drive, has_pulse):
            return device.encode_reference(seq, drive, t_apply_us, has_pulse)
        case KeepAlive(seq):
            return device.encode_keepalive(seq)
        case TimeRequest(t_host_ns):
            return device.encode_time_request(t_host_ns)
        case SelectController(name):
            return device.encode_set_controller(name)
        case SetModel(mode, model):
            return device.encode_set_model(mode, model)
        case SetWiring():
            return device.encode_set_wiring(command)
        case SetDrive():
            return device.encode_set_drive(command)
        case SetBaud(baud):
            return device.encode_set_baud(baud)
        case HelloRequest():
            return device.encode_hello_request()
        case ClearFault():
            return device.encode_clear_fault()
        case _:
            return _encode_tool(command)


def _encode_tool(command: ToolCommand) -> bytes:
    match command:
        case SetGains(law, bandwidth_1_s, integral_time_s):
            return device.encode_set_controller(law, bandwidth_1_s=bandwidth_1_s, integral_time_s=integral_time_s)
        case ControllerRequest():
            return device.encode_controller_request()
        case Sweep():
            return device.encode_sweep(command)
        case RawVoltage():
            return device.encode_raw_voltage(command)
        case SetTelemetry(rate_hz):
            return device.encode_set_telemetry(rate_hz)
        case LogRequest():
            return device.encode_log_request()
        case Stop():
            return device.encode_stop()
