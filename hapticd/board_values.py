"""The vocabulary of the board: its calibration, and the commands and messages that have another shape than their bytes.

The others are in `board_protocol`. Units and phasors as in `hapticd.values`; wrapped board times are 32-bit
microseconds. Values are checked when a command is encoded or a message decoded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

from . import board_protocol as protocol
from .board_protocol import BoardState, PlainCommand, PlainMessage, SetBaud, SetDrive, SetTelemetry
from .values import SafeDrive


def is_within(value: float, bounds: tuple[float, float]) -> bool:
    """Return whether `value` lies within `bounds`, ends included; False for NaN."""
    return bounds[0] <= value <= bounds[1] and math.isfinite(value)


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
class BoardCalibration:
    """The calibrated modes, and the drive to set; None: the board's own."""

    modes: tuple[ModeCalibration, ...] = ()
    drive_hz: float | None = None


UNCALIBRATED: Final = BoardCalibration()


@dataclass(frozen=True, slots=True)
class ModeModel:
    """One mode as the board's controller models it; `loop` is the loop's constant phase as a unit phasor."""

    decay_1_s: float
    detuning_rad_s: float
    gain_um_per_v_s: float
    loop: complex


# --- commands ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SetController:
    """Select a control law of `protocol.LAWS`: "pi" (the paper's four), "pi_ff" (feed-forward) or "deadbeat"
    (observer), and its gains; None is the firmware's default."""

    kind: ClassVar = protocol.MSG_SET_CONTROLLER
    law: str
    bandwidth_1_s: float | None = None
    integral_time_s: float | None = None


@dataclass(frozen=True, slots=True)
class SetModel:
    """Set the model by which the board controls one mode."""

    kind: ClassVar = protocol.MSG_SET_MODEL
    mode: int
    model: ModeModel


@dataclass(frozen=True, slots=True)
class SetWiring:
    """Set all wires at once: `drive` amplifiers by modes, `sense` modes by sensors, `feedthrough_um_per_v` modes by
    amplifiers."""

    kind: ClassVar = protocol.MSG_SET_WIRING
    drive: tuple[tuple[float, ...], ...]
    sense: tuple[tuple[complex, ...], ...]
    feedthrough_um_per_v: tuple[tuple[complex, ...], ...]

    @classmethod
    def of(cls, calibration: BoardCalibration, modes: int) -> SetWiring | None:
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


class ReferenceFrame(NamedTuple):
    """A numbered drive with its start on the board's wrapped clock; with a pulse of the sync output when it takes
    effect."""

    seq: int
    t_apply_us: int
    drive: SafeDrive
    has_pulse: bool = False


BoardSetting = SetController | SetModel | SetWiring | SetDrive | SetBaud | SetTelemetry
BoardCommand = PlainCommand | SetController | SetModel | SetWiring | ReferenceFrame

# --- messages ---------------------------------------------------------------------------------------------------


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


class BoardStatus(NamedTuple):
    """The board's report after each reference frame, and ten times a second otherwise.

    Times are wrapped board times. `seq` is the last accepted frame, `t_received_us` its arrival, `t_applied_us` when
    its first knot took effect (0 and `applied` False while it is pending). `measured_um` is per mode, `voltage_v` per
    amplifier. `drive_hz` follows the plate; 0 of a board that does not say it. `pulsed`: the sync output rose as
    this frame took effect. `number` counts statuses; None of a board that does not. `refusal` is why frame
    `refused_seq`, the session's last that was not taken, was refused (`board_protocol.REFUSALS`); 0: none was.
    `holdable_frac` (M,) is the share of each mode's limit that the voltage holds now; () if the board is silent on it.
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
    holdable_frac: tuple[float, ...] = ()


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


BoardMessage = PlainMessage | BoardHello | BoardStatus | BoardController | SweepPoint | TelemetrySample | BoardLog
