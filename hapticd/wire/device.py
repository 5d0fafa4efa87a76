"""Encoders of the board's commands, and the checks of its handshake. The contract is firmware/PROTOCOL.md.

A message is a type byte and a packed little-endian payload in a frame of `framing`. Encoders check values that a user
may have typed and raise ValueError; the daemon's own references were checked before.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache

from ..board_values import BoardHello, Calibration, ModeModel, RawVoltage, SetDrive, SetWiring, Sweep
from ..errors import DeviceError
from . import protocol
from .board_messages import Decoder as Decoder
from .framing import encode_frame
from .reference import encode_reference as encode_reference

ALL_COMMANDS = sum(1 << number for name, number in vars(protocol).items() if name.startswith("MSG_") and number < 32)


def encode_hello_request() -> bytes:
    """Request the board's identity. The board zeroes its output and resets sequence numbers: a new session."""
    return encode_frame(_typed(protocol.MSG_HELLO_REQUEST))


def encode_keepalive(seq: int) -> bytes:
    """Keep reference `seq`: restarts the board's 50 ms dead-man if that is the last it accepted."""
    return encode_frame(_typed(protocol.MSG_KEEPALIVE) + protocol.KEEPALIVE.pack(seq & 0xFFFF))


def encode_time_request(t_host_ns: int) -> bytes:
    """Request the board's clock; the answer repeats the stamp."""
    return encode_frame(_typed(protocol.MSG_TIME_REQUEST) + protocol.TIME_REQUEST.pack(t_host_ns))


def encode_clear_fault() -> bytes:
    """Clear a latched fault: the board returns to quiet."""
    return encode_frame(_typed(protocol.MSG_CLEAR_FAULT))


def encode_set_controller(
    law: str, *, bandwidth_1_s: float | None = None, integral_time_s: float | None = None
) -> bytes:
    """Select a control law of `protocol.LAWS`; omitted gains are the firmware's defaults.

    Raises ValueError for another name or a gain outside the bounds of `protocol`.
    """
    if law not in protocol.LAWS:
        raise ValueError(f"There is no controller {law!r}: choose one of {', '.join(protocol.LAWS)}.")
    default = 0.0  # on the wire: the firmware's default
    gains = (
        default if bandwidth_1_s is None else _checked("bandwidth_1_s", bandwidth_1_s, protocol.BANDWIDTH_1_S),
        default if integral_time_s is None else _checked("integral_time_s", integral_time_s, protocol.INTEGRAL_TIME_S),
    )
    return encode_frame(_typed(protocol.MSG_SET_CONTROLLER) + protocol.SET_CONTROLLER.pack(protocol.LAWS[law], *gains))


def encode_set_model(mode: int, model: ModeModel) -> bytes:
    """Set the controller's model of a mode, until the board's next reset.

    Raises ValueError for a value outside the bounds of `protocol`, or a loop that is no unit phasor.
    """
    if not abs(abs(model.loop) - 1.0) < 5e-4:
        raise ValueError(f"loop has the magnitude {abs(model.loop):g}: it must be a unit phasor.")
    payload = protocol.SET_MODEL.pack(
        _checked("mode", mode, (0, 254)),
        _checked("decay_1_s", model.decay_1_s, protocol.DECAY_1_S),
        _checked("detuning_rad_s", model.detuning_rad_s, protocol.DETUNING_RAD_S),
        _checked("gain_um_per_v_s", model.gain_um_per_v_s, protocol.GAIN_UM_PER_V_S),
        model.loop.real,
        model.loop.imag,
    )
    return encode_frame(_typed(protocol.MSG_SET_MODEL) + payload)


def encode_set_wiring(wiring: SetWiring) -> bytes:
    """Set which amplifiers drive the modes and which sensors measure them, until the board's next reset.

    Raises ValueError for a value outside the bounds of `protocol`; the board refuses amplifiers that cannot drive the
    modes independently.
    """
    values = [_checked("drive", share, protocol.DRIVE_SHARE) for row in wiring.drive for share in row]
    for name, matrix, bounds in (
        ("sense", wiring.sense, protocol.SENSE),
        ("feedthrough_um_per_v", wiring.feedthrough_um_per_v, protocol.FEEDTHROUGH_UM_PER_V),
    ):
        for value in (complex(value) for row in matrix for value in row):
            _checked(name, abs(value), bounds)
            values += [value.real, value.imag]
    return encode_frame(_typed(protocol.MSG_SET_WIRING) + struct.pack(f"<{len(values)}f", *values))


def encode_set_drive(drive: SetDrive) -> bytes:
    """Set the drive, until the board's next reset. Raises ValueError for values that no board accepts."""
    payload = protocol.SET_DRIVE.pack(
        _checked("drive_hz", drive.drive_hz, protocol.DRIVE_HZ),
        _checked("follow_hz", drive.follow_hz, protocol.FOLLOW_HZ),
    )
    return encode_frame(_typed(protocol.MSG_SET_DRIVE) + payload)


def encode_set_baud(baud: int) -> bytes:
    """Set the line's speed, from the board's VERDICT on. Raises ValueError for a speed that no board accepts."""
    return encode_frame(
        _typed(protocol.MSG_SET_BAUD) + protocol.SET_BAUD.pack(int(_checked("baud", baud, protocol.BAUD)))
    )


def encode_controller_request() -> bytes:
    """Request the active law, gains and models."""
    return encode_frame(_typed(protocol.MSG_CONTROLLER_REQUEST))


def encode_sweep(sweep: Sweep) -> bytes:
    """Start a sweep. The board checks frequency and voltage against its own limits and answers a VERDICT.

    Raises ValueError for values that no board accepts.
    """
    payload = protocol.SWEEP.pack(
        _checked("mode", sweep.mode, (0, 254)),
        _checked("start_hz", sweep.start_hz, (1.0, 1e6)),
        _checked("stop_hz", sweep.stop_hz, (1.0, 1e6)),
        _checked("points", sweep.points, protocol.SWEEP_POINTS),
        _checked("dwell_ms", sweep.dwell_ms, protocol.SWEEP_DWELL_MS),
        _checked("voltage_v", sweep.voltage_v, (1e-3, 1e4)),
    )
    return encode_frame(_typed(protocol.MSG_SWEEP) + payload)


def encode_raw_voltage(raw: RawVoltage) -> bytes:
    """Apply a voltage to one amplifier; answered by a VERDICT. Raises ValueError for values that no board accepts."""
    _checked("the voltage's magnitude", abs(raw.voltage_v), (0.0, 1e4))
    payload = protocol.RAW_VOLTAGE.pack(
        _checked("mode", raw.mode, (0, 254)),
        raw.voltage_v.real,
        raw.voltage_v.imag,
        _checked("duration_ms", raw.duration_ms, protocol.RAW_DURATION_MS),
    )
    return encode_frame(_typed(protocol.MSG_RAW_VOLTAGE) + payload)


def encode_set_telemetry(rate_hz: int) -> bytes:
    """Start a stream of at most `rate_hz` samples a second; 0 stops it."""
    payload = protocol.SET_TELEMETRY.pack(_checked("rate_hz", rate_hz, protocol.TELEMETRY_RATE_HZ))
    return encode_frame(_typed(protocol.MSG_SET_TELEMETRY) + payload)


def encode_log_request() -> bytes:
    """Request the cause of the last reset and the log."""
    return encode_frame(_typed(protocol.MSG_LOG_REQUEST))


def encode_stop() -> bytes:
    """Stop a sweep or raw voltage: the voltage ramps down."""
    return encode_frame(_typed(protocol.MSG_STOP))


def check_protocol(hello: BoardHello) -> None:
    """Raise DeviceError if the board has another protocol version, or another hash without knowing every command."""
    if hello.protocol_version != protocol.PROTOCOL_VERSION:
        raise DeviceError(
            f"The board has protocol version {hello.protocol_version}, this hapticd {protocol.PROTOCOL_VERSION}: "
            f"flash the firmware that came with this hapticd."
        )
    if hello.protocol_hash != protocol.PROTOCOL_HASH and hello.commands & ALL_COMMANDS != ALL_COMMANDS:
        raise DeviceError(
            f"The board has protocol hash {hello.protocol_hash:08x}, this hapticd {protocol.PROTOCOL_HASH:08x}: "
            f"flash the firmware that came with this hapticd."
        )


def check_hello(hello: BoardHello, *, modes: int, w_limit_um: Sequence[float], v_limit_v: float | None = None) -> None:
    """Raise DeviceError if this board must not be driven with these settings.

    A board may allow more than the settings: each side applies its own limit.
    """
    check_protocol(hello)
    for name, value, bounds in (
        ("control_hz", hello.control_hz, protocol.CONTROL_HZ),
        ("drive_hz", hello.drive_hz, protocol.DRIVE_HZ),
        ("v_limit_v", hello.v_limit_v, protocol.V_LIMIT_V),
        ("deadman_ms", hello.deadman_ms, (protocol.DEADMAN_MS, protocol.DEADMAN_MS)),
    ):
        if not protocol.is_within(value, bounds):
            raise DeviceError(
                f"The board's HELLO makes no sense: {name} is {value:g}, not within {bounds[0]:g}..{bounds[1]:g}: "
                f"flash the firmware that came with this hapticd."
            )
    if hello.modes != modes:
        raise DeviceError(
            f"The board drives {hello.modes} modes, the mode map has {modes}: use a matching map and firmware."
        )
    for k, (allowed_um, requested_um) in enumerate(zip(hello.w_limit_um, w_limit_um, strict=True)):
        if not requested_um <= allowed_um * (1.0 + 1e-6):
            raise DeviceError(
                f"The limit of mode {k} is set to {requested_um:g} um but the board allows {allowed_um:g} um: "
                f"set it to {allowed_um:g} or less."
            )
    if v_limit_v is not None and not v_limit_v >= hello.v_limit_v * (1.0 - 1e-6):
        raise DeviceError(
            f"The board drives up to {hello.v_limit_v:g} V but the amplifiers are rated for {v_limit_v:g} V: "
            f"flash a firmware for these amplifiers."
        )


def check_calibration(hello: BoardHello, calibration: Calibration) -> None:
    """Raise DeviceError if the drive to be set, or a mode, is too far away for the board."""
    drive_hz = hello.drive_hz if calibration.drive_hz is None else calibration.drive_hz
    if not protocol.is_within(drive_hz - hello.drive_hz, protocol.DRIVE_MOVE_HZ):
        raise DeviceError(
            f"The calibration file sets the drive to {drive_hz:g} Hz but the board's is {hello.drive_hz:g} Hz, and it "
            f"moves by {protocol.DRIVE_MOVE_HZ[1]:g} Hz at most: set DRIVE_HZ in the firmware, or drive_hz in the file."
        )
    for measured in calibration.modes:
        if not protocol.is_within(measured.model(drive_hz).detuning_rad_s, protocol.DETUNING_RAD_S):
            raise DeviceError(
                f"Mode {measured.mode} is calibrated at {measured.frequency_hz:g} Hz but the board drives at "
                f"{drive_hz:g} Hz: measure it again with `hapticd firmware sweep`."
            )


@cache
def _typed(message: int) -> bytes:
    return bytes((message,))


def _checked(name: str, value: float, bounds: tuple[float, float]) -> float:
    if not protocol.is_within(value, bounds):
        raise ValueError(f"{name} is {value:g}, not within {bounds[0]:g}..{bounds[1]:g}.")
    return value
