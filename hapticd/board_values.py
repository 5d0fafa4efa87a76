"""The vocabulary of the board: commands to it, messages from it, and its calibration.

Units and phasors as in `hapticd.values`; wrapped board times are 32-bit microseconds. Values are checked when a command
is encoded or a message decoded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from .values import SafeDrive

# --- calibration ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ModeCalibration:
    """One mode as measured by a sweep; `loop_phase_rad` is the phase of amplifier, electrodes and sensor.

    The wiring is empty or has a number for each of the board's wires: `drive` what each amplifier gives per volt of
    the mode, `sense` the weight of each sensor in the mode's amplitude, `feedthrough_um_per_v` what a volt of each
    amplifier adds to that without moving the mode.
    """

    mode: int
    frequency_hz: float
    q_factor: float
    gain_um_per_v_s: float
    loop_phase_rad: float
    drive: tuple[float, ...] = ()
    sense: tuple[complex, ...] = ()
    feedthrough_um_per_v: tuple[complex, ...] = ()

    def model(self, drive_hz: float) -> ModeModel:
        """Return the same mode in the frame that rotates at `drive_hz`."""
        return ModeModel(
            decay_1_s=math.pi * self.frequency_hz / self.q_factor,
            detuning_rad_s=2.0 * math.pi * (self.frequency_hz - drive_hz),
            gain_um_per_v_s=self.gain_um_per_v_s,
            loop=complex(math.cos(self.loop_phase_rad), math.sin(self.loop_phase_rad)),
        )


@dataclass(frozen=True, slots=True)
class Calibration:
    """The calibrated modes, and the drive to set; None: the board's own."""

    modes: tuple[ModeCalibration, ...] = ()
    drive_hz: float | None = None


UNCALIBRATED: Final = Calibration()


@dataclass(frozen=True, slots=True)
class ModeModel:
    """One mode as the board's controller models it; `loop` is the loop's constant phase as a unit phasor."""

    decay_1_s: float
    detuning_rad_s: float
    gain_um_per_v_s: float
    loop: complex


# --- commands of the daemon -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class HelloRequest:
    """Request the board's identity. The board zeroes its output and discards earlier frames."""


@dataclass(frozen=True, slots=True)
class SelectController:
    """Select the board's control law: "pi" (the paper's four), "pi_ff" (feed-forward) or "deadbeat" (observer)."""

    name: str


@dataclass(frozen=True, slots=True)
class SetModel:
    """Set the model by which the board controls one mode."""

    mode: int
    model: ModeModel


@dataclass(frozen=True, slots=True)
class SetWiring:
    """Set all wires at once: `drive` amplifiers by modes, `sense` modes by sensors, `feedthrough_um_per_v` modes by
    amplifiers."""

    drive: tuple[tuple[float, ...], ...]
    sense: tuple[tuple[complex, ...], ...]
    feedthrough_um_per_v: tuple[tuple[complex, ...], ...]

    @classmethod
    def of(cls, calibration: Calibration, modes: int) -> SetWiring | None:
        """Return the measured wires, a mode without any having its own; None if no mode has any."""
        if not any(measured.drive or measured.sense or measured.feedthrough_um_per_v for measured in calibration.modes):
            return None
        known = {measured.mode: measured for measured in calibration.modes}
        own = [tuple(float(row == column) for column in range(modes)) for row in range(modes)]
        none = (0.0,) * modes
        columns = [(known[mode].drive if mode in known else ()) or own[mode] for mode in range(modes)]
        return cls(
            drive=tuple(zip(*columns, strict=True)),
            sense=tuple((known[mode].sense if mode in known else ()) or own[mode] for mode in range(modes)),
            feedthrough_um_per_v=tuple(
                (known[mode].feedthrough_um_per_v if mode in known else ()) or none for mode in range(modes)
            ),
        )


@dataclass(frozen=True, slots=True)
class SetTelemetry:
    """Stream samples of the control tick, at most `rate_hz` a second; 0 stops the stream."""

    rate_hz: int


@dataclass(frozen=True, slots=True)
class SetDrive:
    """Set the drive, and how far it follows the plate to either side. The modes stay at their frequencies."""

    drive_hz: float
    follow_hz: float


@dataclass(frozen=True, slots=True)
class SetBaud:
    """Set the line's speed, from the answer on; a board that then receives nothing valid returns to its first one."""

    baud: int


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """Request the board's clock; the answer repeats the stamp."""

    t_host_ns: int


class ReferenceFrame(NamedTuple):
    """A numbered drive with its start on the board's wrapped clock; with a pulse of the sync output when it takes
    effect."""

    seq: int
    t_apply_us: int
    drive: SafeDrive
    has_pulse: bool = False


@dataclass(frozen=True, slots=True)
class KeepAlive:
    """Reset the dead-man timer: frame `seq` stays valid."""

    seq: int


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Leave a latched fault."""


BoardCommand = (
    HelloRequest
    | SelectController
    | SetModel
    | SetWiring
    | SetTelemetry
    | SetDrive
    | SetBaud
    | TimeRequest
    | ReferenceFrame
    | KeepAlive
    | ClearFault
)

# --- messages to the daemon -------------------------------------------------------------------------------------


class BoardState(Enum):
    """The firmware's state. Values are those on the wire."""

    QUIET = 0  # no trusted stream of frames: output ramped to zero
    LIVE = 1  # following references
    FAULT = 2  # latched: no output until cleared
    TOOL = 3  # a sweep or raw voltage drives the plate


@dataclass(frozen=True, slots=True)
class BoardHello:
    """The board's identity, rates and limits, sent at the handshake.

    `drive_hz` is the drive that was set last. `image_crc` is that of the flashed program, `baud_max` the fastest line
    that the board offers: 0 where there is none. `commands` has bit n for each message type n that it understands.
    """

    protocol_version: int
    protocol_hash: int
    firmware_version: str
    boot_id: int
    modes: int
    control_hz: float
    drive_hz: float
    deadman_ms: int
    w_limit_um: tuple[float, ...]
    v_limit_v: float
    image_crc: int = 0
    baud_max: int = 0
    has_sync: bool = False
    commands: int = 0


@dataclass(frozen=True, slots=True)
class BoardStatus:
    """The board's report after each reference frame, and ten times a second otherwise.

    Times are wrapped board times. `seq` is the last accepted frame, `t_received_us` its arrival, `t_applied_us` when
    its first knot took effect (0 and `applied` False while it is pending). `measured_um` is per mode, `voltage_v` per
    amplifier. `drive_hz` follows the plate; 0 of a board that does not say it. `pulsed`: the sync output rose as
    this frame took effect. `number` counts statuses; None of a board that does not. `refusal` is why frame
    `refused_seq`, the session's last that was not taken, was refused (`wire.protocol.REFUSALS`); 0: none was.
    """

    t_board_us: int
    state: BoardState
    seq: int
    t_received_us: int
    t_applied_us: int
    applied: bool
    saturated: bool
    limited: bool
    fault_code: int
    deadman_trips: int
    bad_frames: int
    late_frames: int
    measured_um: tuple[complex, ...]
    voltage_v: tuple[complex, ...]
    drive_hz: float = 0.0
    pulsed: bool = False
    number: int | None = None
    refused_seq: int = 0
    refusal: int = 0


@dataclass(frozen=True, slots=True)
class BoardTime:
    """Answer to a time request: the host's stamp, and the board's clock at receipt and at reply."""

    t_host_ns: int
    t_received_us: int
    t_sent_us: int


BoardMessage = BoardHello | BoardStatus | BoardTime

# --- commands of the bench tools --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SetGains:
    """Select a control law and its gains; None keeps the firmware's default."""

    law: str
    bandwidth_1_s: float | None = None
    integral_time_s: float | None = None


@dataclass(frozen=True, slots=True)
class ControllerRequest:
    """Request the active law, gains and mode models."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """Drive one mode open loop with `voltage_v` at `points` frequencies, for `dwell_ms` each."""

    mode: int
    start_hz: float
    stop_hz: float
    points: int
    dwell_ms: int
    voltage_v: float


@dataclass(frozen=True, slots=True)
class RawVoltage:
    """Apply a voltage to one amplifier, open loop, for `duration_ms`; repeating the command extends it."""

    mode: int
    voltage_v: complex
    duration_ms: int


@dataclass(frozen=True, slots=True)
class LogRequest:
    """Request the cause of the last reset and the event log."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop a sweep or raw voltage."""


ToolCommand = SetGains | ControllerRequest | Sweep | RawVoltage | SetTelemetry | LogRequest | Stop

# --- messages to the bench tools --------------------------------------------------------------------------------


class Verdict(Enum):
    """The result of a command. Values are those on the wire."""

    DONE = 0
    OUT_OF_RANGE = 1
    NOT_QUIET = 2  # the board is busy or has a fault


@dataclass(frozen=True, slots=True)
class BoardVerdict:
    """The board's answer to the command of message type `request`."""

    request: int
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class BoardController:
    """The active control law. `law` is None for a number that this version does not know."""

    law: str | None
    bandwidth_1_s: float
    integral_time_s: float
    models: tuple[ModeModel, ...]


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """Mean amplitudes of all modes with `voltage_v` on the d axis of the amplifier of `mode`."""

    index: int
    points: int
    mode: int
    frequency_hz: float
    voltage_v: float
    measured_um: tuple[complex, ...]


@dataclass(frozen=True, slots=True)
class ModeSample:
    """One mode in one control tick, with the observer's estimates of decay and detuning."""

    reference_um: complex
    measured_um: complex
    voltage_v: complex
    decay_1_s: float
    detuning_rad_s: float


@dataclass(frozen=True, slots=True)
class TelemetrySample:
    """One control tick. `dropped` counts the samples of this stream lost before it."""

    t_board_us: int
    dropped: int
    state: BoardState
    saturated: bool
    limited: bool
    modes: tuple[ModeSample, ...]


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One logged event; `mode` is None where no single mode is concerned, `value` is the measurement."""

    t_board_us: int
    boot_id: int
    code: int
    mode: int | None
    value: float


@dataclass(frozen=True, slots=True)
class BoardLog:
    """The cause of the last reset, and the newest of the `events` ever logged, oldest first."""

    reset_cause: int
    events: int
    entries: tuple[LogEntry, ...]


ToolMessage = BoardVerdict | BoardController | SweepPoint | TelemetrySample | BoardLog
