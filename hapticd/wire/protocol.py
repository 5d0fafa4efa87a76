"""Constants of the board protocol. `firmware/core/protocol.h` is the source; a test compares the two.

Layouts are packed and little endian. For messages that grow with the number of modes they are the fixed part; the
comment names what follows.
"""

from __future__ import annotations

import math
import struct
from typing import Final

PROTOCOL_VERSION: Final = 2
PROTOCOL_HASH: Final = 0x5B0A791E

KNOTS_MAX: Final = 24
REFERENCE_PULSE: Final = 0x80  # added to the number of knots: the sync output rises when it takes effect
FEATURE_SYNC: Final = 0x01
KNOT_UNIT_NS: Final = 4000
OFFSET_MAX_NS: Final = 0xFFFF * KNOT_UNIT_NS
DEADMAN_MS: Final = 50

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

REFERENCE: Final = struct.Struct("<HIBB")  # then for each knot its offset and a phasor per mode
KEEPALIVE: Final = struct.Struct("<H")
TIME_REQUEST: Final = struct.Struct("<Q")
SET_CONTROLLER: Final = struct.Struct("<Bff")
SET_MODEL: Final = struct.Struct("<Bfffff")
SET_DRIVE: Final = struct.Struct("<ff")
SET_BAUD: Final = struct.Struct("<I")
SWEEP: Final = struct.Struct("<BffHHf")
RAW_VOLTAGE: Final = struct.Struct("<BffH")
SET_TELEMETRY: Final = struct.Struct("<H")
HELLO: Final = struct.Struct("<HIB16sIffHf")  # then the amplitude limit of each mode, then MORE_HELLO
MORE_HELLO: Final = struct.Struct("<IIBI")
STATUS: Final = struct.Struct("<IBBBBHIIHII")  # then measured d, q and voltage d, q of each mode, and MORE_STATUS
MORE_STATUS: Final = struct.Struct("<fHHB")
TIME: Final = struct.Struct("<QII")
CONTROLLER: Final = struct.Struct("<BffB")  # then decay, detuning, gain and loop d, q of each mode
SWEEP_POINT: Final = struct.Struct("<HHBBff")  # then measured d, q of each mode
TELEMETRY: Final = struct.Struct("<IIBBB")  # then reference, measured, voltage (d, q), decay, detuning of each mode
LOG: Final = struct.Struct("<BBI")  # then LOG_ENTRIES entries
LOG_ENTRY: Final = struct.Struct("<IIBBf")
VERDICT: Final = struct.Struct("<BB")

# Bounds of a sound HELLO, ends included.
CONTROL_HZ: Final = (500.0, 50000.0)
DRIVE_HZ: Final = (1.0, 1e6)
V_LIMIT_V: Final = (1e-6, 1e6)

# Bounds of command fields, ends included.
BANDWIDTH_1_S: Final = (10.0, 20000.0)
INTEGRAL_TIME_S: Final = (0.0001, 1.0)
DECAY_1_S: Final = (1.0, 10000.0)
DETUNING_RAD_S: Final = (-20000.0, 20000.0)
GAIN_UM_PER_V_S: Final = (0.001, 10000.0)
DRIVE_SHARE: Final = (-10.0, 10.0)
SENSE: Final = (0.0, 100.0)  # magnitude
FEEDTHROUGH_UM_PER_V: Final = (0.0, 1.0)  # magnitude
FOLLOW_HZ: Final = (0.0, 500.0)
DRIVE_MOVE_HZ: Final = (-2000.0, 2000.0)  # of SET_DRIVE, from the one that the board started with
BAUD: Final = (9600, 10_000_000)
SWEEP_POINTS: Final = (1, 2001)
SWEEP_DWELL_MS: Final = (1, 1000)
SWEEP_OFFSET_HZ: Final = (-2000.0, 2000.0)  # from the drive frequency
RAW_LIMIT_FRAC: Final = 0.2  # of the board's voltage limit; for sweeps too
RAW_DURATION_MS: Final = (1, 1000)
TELEMETRY_RATE_HZ: Final = (0, 0xFFFF)
LOG_ENTRIES: Final = 8
ALL_MODES: Final = 255  # in a log entry: no single mode is concerned

LAWS: Final = {"pi": 0, "pi_ff": 1, "deadbeat": 2}

COMMANDS: Final = {
    MSG_SET_CONTROLLER: "the control law or its gains",
    MSG_SET_MODEL: "the calibration of a mode",
    MSG_SET_WIRING: "the calibration of the wiring",
    MSG_SET_DRIVE: "the drive",
    MSG_SET_BAUD: "the speed of the line",
    MSG_SWEEP: "the sweep",
    MSG_RAW_VOLTAGE: "the raw voltage",
    MSG_SET_TELEMETRY: "the telemetry",
    MSG_STOP: "to stop",
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
    8: "the plate moves against its drive: wires of amplifiers or sensors are swapped or inverted, "
    "and `hapticd calibrate resonance` says which",
    9: "a sensor's converter is at its rails: its bias is off, or its range too small",
    10: "the amplifiers were at their limit for 100 s without reaching the reference",
}

REFUSALS: Final = {
    1: "its length, modes, knots or values are not valid",
    2: "it begins more than 1 s from now",
    3: "it began more than 50 ms ago",
    4: "it is not newer than the last one taken",
    5: "a sweep or a raw voltage drives the plate",
}

EVENTS: Final = {
    64: "dead-man timeout: the drive was ramped down",
    65: "dead-man timeout: a sweep or raw voltage was stopped",
    66: "samples were lost",
    67: "the crystal did not start: the board does not drive",
    68: "the program crashed",
}

BOARD_EVENTS: Final = {
    96: "the program in the flash is damaged: the board does not drive",
    97: "the chip's brown-out reset is off: the board does not drive; run `make -C firmware protect`",
    98: "the supply fell below 2.9 V",
    99: "an amplifier reported a fault",
    100: "emergency stop",
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


def is_within(value: float, bounds: tuple[float, float]) -> bool:
    """Return whether `value` lies within `bounds`, ends included; False for NaN."""
    return bounds[0] <= value <= bounds[1] and math.isfinite(value)
