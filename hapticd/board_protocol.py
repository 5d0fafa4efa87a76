"""The board's protocol, made of firmware/core/protocol.h by `make -C firmware protocol`: edit that.

A command or message whose value has the shape of its bytes is a class here, the others are in `board_values`. Layouts
are packed and little endian; those of structures with arrays end before the first, and MORE_... is what lies behind
the last. Bounds include their ends, and are those of the magnitude where a value is complex.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Final

Bounds = dict[str, tuple[float, float]]

PROTOCOL_VERSION: Final = 2
PROTOCOL_HASH: Final = 0x5B0A791E
KNOTS_MAX: Final = 24
KNOT_UNIT_NS: Final = 4000
AHEAD_NS: Final = 1000000000
STALE_NS: Final = 50000000
DEADMAN_NS: Final = 50000000
REFERENCE_AGE_NS: Final = 10000000000
SATURATED_NS: Final = 100000000000
REARM_FRAMES: Final = 3
RAMP_NS: Final = 10000000
STATUS_NS: Final = 100000000
PULSE_NS: Final = 5000000
PULSE_EVERY_NS: Final = 20000000
BAUD_MIN: Final = 9600
BAUD_HOLD_NS: Final = 1200000000
REFERENCE_PULSE: Final = 0x80
BANDWIDTH_MIN_1_S: Final = 10.0
BANDWIDTH_MAX_1_S: Final = 20000.0
INTEGRAL_TIME_MIN_S: Final = 0.0001
INTEGRAL_TIME_MAX_S: Final = 1.0
DECAY_MIN_1_S: Final = 1.0
DECAY_MAX_1_S: Final = 10000.0
DETUNING_MAX_RAD_S: Final = 20000.0
GAIN_MIN_UM_PER_V_S: Final = 0.001
GAIN_MAX_UM_PER_V_S: Final = 10000.0
LOOP_TOLERANCE: Final = 0.001
DRIVE_SHARE_MAX: Final = 10.0
SENSE_MAX: Final = 100.0
FEEDTHROUGH_MAX_UM_PER_V: Final = 1.0
RAW_LIMIT_FRAC: Final = 0.2
RAW_MAX_MS: Final = 1000
SWEEP_POINTS_MAX: Final = 2001
SWEEP_DWELL_MIN_MS: Final = 1
SWEEP_DWELL_MAX_MS: Final = 1000
SWEEP_OFFSET_MAX_HZ: Final = 2000.0
LOG_ENTRIES: Final = 8
DRIVE_MOVE_MAX_HZ: Final = 2000.0
FOLLOW_HZ: Final = 120.0
FOLLOW_MAX_HZ: Final = 500.0
MSG_HELLO_REQUEST: Final = 0x01
MSG_REFERENCE: Final = 0x02
MSG_KEEPALIVE: Final = 0x03
MSG_TIME_REQUEST: Final = 0x04
MSG_CLEAR_FAULT: Final = 0x05
MSG_SET_CONTROLLER: Final = 0x06
MSG_SET_MODEL: Final = 0x07
MSG_CONTROLLER_REQUEST: Final = 0x08
MSG_SWEEP: Final = 0x09
MSG_RAW_VOLTAGE: Final = 0x0A
MSG_SET_TELEMETRY: Final = 0x0B
MSG_LOG_REQUEST: Final = 0x0C
MSG_STOP: Final = 0x0D
MSG_SET_WIRING: Final = 0x0E
MSG_SET_DRIVE: Final = 0x0F
MSG_SET_BAUD: Final = 0x10
MSG_HELLO: Final = 0x81
MSG_STATUS: Final = 0x82
MSG_TIME: Final = 0x83
MSG_CONTROLLER: Final = 0x84
MSG_SWEEP_POINT: Final = 0x85
MSG_TELEMETRY: Final = 0x86
MSG_LOG: Final = 0x87
MSG_VERDICT: Final = 0x88


class CommandResult(Enum):
    """The result of a command."""

    DONE = 0
    OUT_OF_RANGE = 1
    NOT_QUIET = 2


VERDICTS: Final = {
    0: "done",
    1: "a value is out of range",
    2: "it is busy or has a fault",
}


class BoardState(Enum):
    """The firmware's state."""

    QUIET = 0
    LIVE = 1
    FAULT = 2
    TOOL = 3


STATES: Final = {
    0: "quiet",
    1: "live: it follows references",
    2: "fault",
    3: "busy with a sweep or a raw voltage",
}

FAULTS: Final = {
    0: "none",
    1: "a measurement was not finite",
    2: "a control voltage was not finite",
    3: "the measured amplitude stayed far above its limit",
    4: "the sensors do not answer the drive",
    5: "dead-man timeout three times within ten seconds",
    6: "the board's configuration is invalid",
    7: "the sensors do not follow the drive: a wrong phase or gain",
    8: "the plate moves against its drive: wires of amplifiers or sensors are swapped or inverted, and `hapticd "
    "calibrate resonance` says which",
    9: "a sensor's converter is at its rails: its bias is off, or its range too small",
    10: "the amplifiers were at their limit for 100 s without reaching the reference",
}

EVENTS: Final = {
    64: "dead-man timeout: the drive was ramped down",
    65: "dead-man timeout: a sweep or raw voltage was stopped",
    66: "samples were lost",
    67: "the crystal did not start: the board does not drive",
    68: "the program crashed",
}

RESET_CAUSES: Final = {
    0: "unknown",
    1: "power-up",
    2: "reset pin",
    3: "software",
    4: "watchdog",
    5: "brown-out",
    6: "low-power management",
}

LAWS: Final = {
    "pi": 0,
    "pi_ff": 1,
    "deadbeat": 2,
}

STATUS_APPLIED: Final = 0x01
STATUS_SATURATED: Final = 0x02
STATUS_LIMITED: Final = 0x04
STATUS_PULSED: Final = 0x08

REFUSALS: Final = {
    0: "none was refused",
    1: "its length, modes, knots or values are not valid",
    2: "it begins more than 1 s from now",
    3: "it began more than 50 ms ago",
    4: "it is not newer than the last one taken",
    5: "a sweep or a raw voltage drives the plate",
}

FEATURE_SYNC: Final = 0x01

BOARD_EVENTS: Final = {
    96: "the program in the flash is damaged: the board does not drive",
    97: "the chip's brown-out reset is off: the board does not drive; run `make -C firmware protect`",
    98: "the supply fell below 2.9 V",
    99: "an amplifier reported a fault: PB14, on the STM32G474 PC6, is open",
    100: "emergency stop: PB15, on the STM32G474 PC7, is open",
}

# What a refusal calls each command that a VERDICT answers.
COMMANDS: Final = {
    MSG_SET_CONTROLLER: "the control law or its gains",
    MSG_SET_MODEL: "the calibration of a mode",
    MSG_SWEEP: "the sweep",
    MSG_RAW_VOLTAGE: "the raw voltage",
    MSG_SET_TELEMETRY: "the telemetry",
    MSG_STOP: "to stop",
    MSG_SET_WIRING: "the calibration of the wiring",
    MSG_SET_DRIVE: "the drive",
    MSG_SET_BAUD: "the speed of the line",
}

EMPTY: Final = struct.Struct("<")
PHASOR: Final = struct.Struct("<ff")
KNOT: Final = struct.Struct("<H")
REFERENCE: Final = struct.Struct("<HIBB")
KEEPALIVE: Final = struct.Struct("<H")
KEEPALIVE_BOUNDS: Final[Bounds] = {
    "seq": (0, 0xFFFF),
}
TIME_REQUEST: Final = struct.Struct("<Q")
TIME_REQUEST_BOUNDS: Final[Bounds] = {
    "t_host_ns": (0, 0xFFFFFFFFFFFFFFFF),
}
SET_CONTROLLER: Final = struct.Struct("<Bff")
SET_CONTROLLER_BOUNDS: Final[Bounds] = {
    "bandwidth_1_s": (10.0, 20000.0),
    "integral_time_s": (0.0001, 1.0),
}
MODEL: Final = struct.Struct("<fffff")
SET_MODEL: Final = struct.Struct("<Bfffff")
SET_MODEL_BOUNDS: Final[Bounds] = {
    "mode": (0, 254),
    "decay_1_s": (1.0, 10000.0),
    "detuning_rad_s": (-20000.0, 20000.0),
    "gain_um_per_v_s": (0.001, 10000.0),
    "loop": (0.9995, 1.0005),
}
SET_WIRING_BOUNDS: Final[Bounds] = {
    "drive": (-10.0, 10.0),
    "sense": (0, 100.0),
    "feedthrough": (0, 1.0),
}
SET_DRIVE: Final = struct.Struct("<ff")
SET_DRIVE_BOUNDS: Final[Bounds] = {
    "drive_hz": (1, 1e6),
    "follow_hz": (0, 500.0),
}
SET_BAUD: Final = struct.Struct("<I")
SET_BAUD_BOUNDS: Final[Bounds] = {
    "baud": (9600, 10000000),
}
SWEEP: Final = struct.Struct("<BffHHf")
SWEEP_BOUNDS: Final[Bounds] = {
    "mode": (0, 254),
    "start_hz": (1, 1e6),
    "stop_hz": (1, 1e6),
    "points": (1, 2001),
    "dwell_ms": (1, 1000),
    "voltage_v": (1e-3, 1e4),
}
RAW_VOLTAGE: Final = struct.Struct("<BffH")
RAW_VOLTAGE_BOUNDS: Final[Bounds] = {
    "mode": (0, 254),
    "voltage_v": (0, 1e4),
    "duration_ms": (1, 1000),
}
SET_TELEMETRY: Final = struct.Struct("<H")
SET_TELEMETRY_BOUNDS: Final[Bounds] = {
    "rate_hz": (0, 65535),
}
HELLO: Final = struct.Struct("<HIB16sIffHf")
HELLO_FIELDS: Final = (
    "protocol_version",
    "protocol_hash",
    "modes",
    "firmware_version",
    "boot_id",
    "control_hz",
    "drive_hz",
    "deadman_ms",
    "v_limit_v",
)
MORE_HELLO: Final = struct.Struct("<IIBI")
MORE_HELLO_FIELDS: Final = ("image_crc", "baud_max", "features", "commands")
HELLO_BOUNDS: Final[Bounds] = {
    "modes": (1, 255),
    "control_hz": (500, 50000),
    "drive_hz": (1, 1e6),
    "deadman_ms": (50, 50),
    "v_limit_v": (1e-6, 1e6),
}
MODE: Final = struct.Struct("<ffff")
STATUS: Final = struct.Struct("<IBBBBHIIHII")
STATUS_FIELDS: Final = (
    "t_board_us",
    "state",
    "flags",
    "fault_code",
    "modes",
    "seq",
    "t_received_us",
    "t_applied_us",
    "deadman_trips",
    "bad_frames",
    "late_frames",
)
MORE_STATUS: Final = struct.Struct("<fHHB")
MORE_STATUS_FIELDS: Final = ("drive_hz", "number", "refused_seq", "refusal")
TIME: Final = struct.Struct("<QII")
CONTROLLER: Final = struct.Struct("<BffB")
CONTROLLER_FIELDS: Final = ("law", "bandwidth_1_s", "integral_time_s", "modes")
SWEEP_POINT: Final = struct.Struct("<HHBBff")
SWEEP_POINT_FIELDS: Final = ("index", "points", "mode", "modes", "frequency_hz", "voltage_v")
TELEMETRY_MODE: Final = struct.Struct("<ffffffff")
TELEMETRY: Final = struct.Struct("<IIBBB")
TELEMETRY_FIELDS: Final = ("t_board_us", "dropped", "state", "flags", "modes")
LOG_ENTRY: Final = struct.Struct("<IIBBf")
LOG: Final = struct.Struct("<BBI")
LOG_FIELDS: Final = ("reset_cause", "entries", "events")
VERDICT: Final = struct.Struct("<BB")


@dataclass(frozen=True, slots=True)
class HelloRequest:
    """Request the board's identity. It zeroes its output and discards earlier frames: a new session."""

    kind: ClassVar = MSG_HELLO_REQUEST
    layout: ClassVar = EMPTY
    bounds: ClassVar[Bounds] = {}


@dataclass(frozen=True, slots=True)
class Keepalive:
    """Reset the dead-man timer. Reference `seq` stays valid."""

    kind: ClassVar = MSG_KEEPALIVE
    layout: ClassVar = KEEPALIVE
    bounds: ClassVar[Bounds] = KEEPALIVE_BOUNDS
    seq: int


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """Request the board's clock. The answer repeats the stamp."""

    kind: ClassVar = MSG_TIME_REQUEST
    layout: ClassVar = TIME_REQUEST
    bounds: ClassVar[Bounds] = TIME_REQUEST_BOUNDS
    t_host_ns: int


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Leave a latched fault."""

    kind: ClassVar = MSG_CLEAR_FAULT
    layout: ClassVar = EMPTY
    bounds: ClassVar[Bounds] = {}


@dataclass(frozen=True, slots=True)
class ControllerRequest:
    """Request the active law, gains and mode models."""

    kind: ClassVar = MSG_CONTROLLER_REQUEST
    layout: ClassVar = EMPTY
    bounds: ClassVar[Bounds] = {}


@dataclass(frozen=True, slots=True)
class Sweep:
    """Drive one mode open loop with `voltage_v` at `points` frequencies, for `dwell_ms` each."""

    kind: ClassVar = MSG_SWEEP
    layout: ClassVar = SWEEP
    bounds: ClassVar[Bounds] = SWEEP_BOUNDS
    mode: int
    start_hz: float
    stop_hz: float
    points: int
    dwell_ms: int
    voltage_v: float


@dataclass(frozen=True, slots=True)
class RawVoltage:
    """Apply a voltage to one amplifier, open loop. Repeating the command extends it."""

    kind: ClassVar = MSG_RAW_VOLTAGE
    layout: ClassVar = RAW_VOLTAGE
    bounds: ClassVar[Bounds] = RAW_VOLTAGE_BOUNDS
    mode: int
    voltage_v: complex
    duration_ms: int


@dataclass(frozen=True, slots=True)
class SetTelemetry:
    """Stream samples of the control tick, at most `rate_hz` a second."""

    kind: ClassVar = MSG_SET_TELEMETRY
    layout: ClassVar = SET_TELEMETRY
    bounds: ClassVar[Bounds] = SET_TELEMETRY_BOUNDS
    rate_hz: int


@dataclass(frozen=True, slots=True)
class LogRequest:
    """Request the cause of the last reset and the event log."""

    kind: ClassVar = MSG_LOG_REQUEST
    layout: ClassVar = EMPTY
    bounds: ClassVar[Bounds] = {}


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop a sweep or raw voltage. The voltage ramps down."""

    kind: ClassVar = MSG_STOP
    layout: ClassVar = EMPTY
    bounds: ClassVar[Bounds] = {}


@dataclass(frozen=True, slots=True)
class SetDrive:
    """Set the drive, and how far it follows the plate to either side. The modes stay at their frequencies."""

    kind: ClassVar = MSG_SET_DRIVE
    layout: ClassVar = SET_DRIVE
    bounds: ClassVar[Bounds] = SET_DRIVE_BOUNDS
    drive_hz: float
    follow_hz: float


@dataclass(frozen=True, slots=True)
class SetBaud:
    """Set the line's speed, from the answer on. A board that then receives nothing valid for HD_BAUD_HOLD_US returns to
    its first one."""

    kind: ClassVar = MSG_SET_BAUD
    layout: ClassVar = SET_BAUD
    bounds: ClassVar[Bounds] = SET_BAUD_BOUNDS
    baud: int


@dataclass(frozen=True, slots=True)
class BoardTime:
    """Answer to a time request: the host's stamp, and the board's clock at receipt and at reply."""

    kind: ClassVar = MSG_TIME
    layout: ClassVar = TIME
    bounds: ClassVar[Bounds] = {}
    t_host_ns: int
    t_received_us: int
    t_sent_us: int


@dataclass(frozen=True, slots=True)
class BoardVerdict:
    """The board's answer to the command of message type `request`."""

    kind: ClassVar = MSG_VERDICT
    layout: ClassVar = VERDICT
    bounds: ClassVar[Bounds] = {}
    request: int
    verdict: CommandResult


PlainCommand = (
    HelloRequest
    | Keepalive
    | TimeRequest
    | ClearFault
    | ControllerRequest
    | Sweep
    | RawVoltage
    | SetTelemetry
    | LogRequest
    | Stop
    | SetDrive
    | SetBaud
)

PlainMessage = BoardTime | BoardVerdict
