"""Bytes to the board; those from it are read in `board_messages`. `firmware/PROTOCOL.md` says what they mean.

A message is a type byte and a packed little-endian payload in a frame of `framing`. Encoders check what a person may
have typed and raise ValueError; what the daemon itself decided has been checked before.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from ..board_values import BoardHello, ModeCalibration, ModeModel, RawVoltage, Sweep
from ..errors import DeviceError
from . import protocol
from .board_messages import Decoder
from .framing import encode_frame
from .reference import encode_reference

__all__ = [
    "Decoder",
    "check_calibration",
    "check_hello",
    "check_protocol",
    "encode_clear_fault",
    "encode_controller_request",
    "encode_hello_request",
    "encode_keepalive",
    "encode_log_request",
    "encode_raw_voltage",
    "encode_reference",
    "encode_set_controller",
    "encode_set_model",
    "encode_set_telemetry",
    "encode_stop",
    "encode_sweep",
    "encode_time_request",
]


def encode_hello_request() -> bytes:
    """Asks who is there. The board falls silent and forgets sequence numbers: a new session begins."""
    return encode_frame(_typed(protocol.MSG_HELLO_REQUEST))


def encode_keepalive(seq: int) -> bytes:
    """The reference `seq` should stand: the board's dead-man waits another 50 ms if that is the last it accepted."""
    return encode_frame(_typed(protocol.MSG_KEEPALIVE) + protocol.KEEPALIVE.pack(seq & 0xFFFF))


def encode_time_request(t_host_ns: int) -> bytes:
    """Asks for the board's clock; the stamp comes back in the answer."""
    return encode_frame(_typed(protocol.MSG_TIME_REQUEST) + protocol.TIME_REQUEST.pack(t_host_ns))


def encode_clear_fault() -> bytes:
    """Lets a board that latched a fault go back to quiet."""
    return encode_frame(_typed(protocol.MSG_CLEAR_FAULT))


def encode_set_controller(
    law: str, *, bandwidth_1_s: float | None = None, integral_time_s: float | None = None
) -> bytes:
    """Selects "pi", the founding paper's four PI, or "pi_ff"; gains left out are the firmware's own.

    Raises ValueError for another name or a gain outside the bounds of `protocol`.
    """
    if law not in protocol.LAWS:
        raise ValueError(f"There is no controller {law!r}: choose one of {', '.join(protocol.LAWS)}.")
    own = 0.0  # on the wire: the firmware's own
    gains = (
        own if bandwidth_1_s is None else _checked("bandwidth_1_s", bandwidth_1_s, protocol.BANDWIDTH_1_S),
        own if integral_time_s is None else _checked("integral_time_s", integral_time_s, protocol.INTEGRAL_TIME_S),
    )
    return encode_frame(_typed(protocol.MSG_SET_CONTROLLER) + protocol.SET_CONTROLLER.pack(protocol.LAWS[law], *gains))


def encode_set_model(mode: int, model: ModeModel) -> bytes:
    """What the controller should believe of a mode, from now until the board's next reset.

    Raises ValueError for a figure outside the bounds of `protocol`, or a loop that is no unit phasor.
    """
    if not abs(abs(model.loop) - 1.0) < 5e-4:
        raise ValueError(f"loop has the magnitude {abs(model.loop):g}: a phase is a phasor of magnitude 1.")
    payload = protocol.SET_MODEL.pack(
        _checked("mode", mode, (0, 254)),
        _checked("decay_1_s", model.decay_1_s, protocol.DECAY_1_S),
        _checked("detuning_rad_s", model.detuning_rad_s, protocol.DETUNING_RAD_S),
        _checked("gain_um_per_v_s", model.gain_um_per_v_s, protocol.GAIN_UM_PER_V_S),
        model.loop.real,
        model.loop.imag,
    )
    return encode_frame(_typed(protocol.MSG_SET_MODEL) + payload)


def encode_controller_request() -> bytes:
    """Asks for law, gains and models in force."""
    return encode_frame(_typed(protocol.MSG_CONTROLLER_REQUEST))


def encode_sweep(sweep: Sweep) -> bytes:
    """Begins a sweep. The board alone knows its drive frequency and voltage limit, and answers a VERDICT.

    Raises ValueError for what no board would take.
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
    """Puts a voltage on one amplifier; the board answers a VERDICT. Raises ValueError for what no board would take."""
    _checked("the voltage's magnitude", abs(raw.voltage_v), (0.0, 1e4))
    payload = protocol.RAW_VOLTAGE.pack(
        _checked("mode", raw.mode, (0, 254)),
        raw.voltage_v.real,
        raw.voltage_v.imag,
        _checked("duration_ms", raw.duration_ms, protocol.RAW_DURATION_MS),
    )
    return encode_frame(_typed(protocol.MSG_RAW_VOLTAGE) + payload)


def encode_set_telemetry(rate_hz: int) -> bytes:
    """Begins a stream of at most `rate_hz` samples a second, or ends it for 0."""
    payload = protocol.SET_TELEMETRY.pack(_checked("rate_hz", rate_hz, protocol.TELEMETRY_RATE_HZ))
    return encode_frame(_typed(protocol.MSG_SET_TELEMETRY) + payload)


def encode_log_request() -> bytes:
    """Asks for the cause of the last reset and the log."""
    return encode_frame(_typed(protocol.MSG_LOG_REQUEST))


def encode_stop() -> bytes:
    """Ends a sweep or a raw voltage: the voltage ramps down."""
    return encode_frame(_typed(protocol.MSG_STOP))


def check_protocol(hello: BoardHello) -> None:
    """Raises DeviceError, in one sentence, if this board speaks another protocol."""
    if hello.protocol_version != protocol.PROTOCOL_VERSION:
        raise DeviceError(
            f"The board speaks protocol version {hello.protocol_version}, this hapticd {protocol.PROTOCOL_VERSION}: "
            f"flash the firmware that came with this hapticd."
        )
    if hello.protocol_hash != protocol.PROTOCOL_HASH:
        raise DeviceError(
            f"The board's protocol hash is {hello.protocol_hash:08x}, this hapticd's {protocol.PROTOCOL_HASH:08x}: "
            f"flash the firmware that came with this hapticd."
        )


def check_hello(hello: BoardHello, *, modes: int, w_limit_um: Sequence[float], v_limit_v: float | None = None) -> None:
    """Raises DeviceError, in one sentence, if this board must not be driven with these settings.

    A board that allows more than the settings is fine: each side holds its own limit.
    """
    check_protocol(hello)
    if hello.modes != modes:
        raise DeviceError(
            f"The board drives {hello.modes} modes, the mode shapes have {modes}: use shapes and firmware that fit."
        )
    for k, (allowed_um, wanted_um) in enumerate(zip(hello.w_limit_um, w_limit_um, strict=True)):
        if not wanted_um <= allowed_um * (1.0 + 1e-6):
            raise DeviceError(
                f"The amplitude limit of mode {k} is set to {wanted_um:g} um but the board allows {allowed_um:g} um: "
                f"set it to {allowed_um:g} or less."
            )
    if v_limit_v is not None and not v_limit_v >= hello.v_limit_v * (1.0 - 1e-6):
        raise DeviceError(
            f"The board drives up to {hello.v_limit_v:g} V but the amplifiers are set to take {v_limit_v:g} V: "
            f"flash a firmware for these amplifiers."
        )


def check_calibration(hello: BoardHello, calibration: Sequence[ModeCalibration]) -> None:
    """Raises DeviceError, in one sentence, if a mode was measured far from where this board drives the plate."""
    for measured in calibration:
        if not protocol.is_within(measured.model(hello.drive_hz).detuning_rad_s, protocol.DETUNING_RAD_S):
            raise DeviceError(
                f"Mode {measured.mode} is calibrated at {measured.frequency_hz:g} Hz but the board drives at "
                f"{hello.drive_hz:g} Hz: measure it again with `hapticd firmware sweep`."
            )


@cache
def _typed(message: int) -> bytes:
    return bytes((message,))


def _checked(name: str, value: float, bounds: tuple[float, float]) -> float:
    if not protocol.is_within(value, bounds):
        raise ValueError(f"{name} is {value:g}, not within {bounds[0]:g}..{bounds[1]:g}.")
    return value
