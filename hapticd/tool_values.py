"""Values of the board's tools: what a person at the bench asks of the board, and what it answers.

Units and phasors as in `values`; figures are checked when a command is encoded or a message decoded.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from .board_values import BoardState, ModeModel

# --- what is asked ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SetGains:
    """The control law with gains of a person's choice; None stands for the firmware's tested ones."""

    law: str
    bandwidth_1_s: float | None = None
    integral_time_s: float | None = None


@dataclass(frozen=True, slots=True)
class ControllerRequest:
    """Which law, which gains, which models of the modes?"""


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
    """Put a voltage on one amplifier, open loop, for `duration_ms`; saying it again gives more time."""

    mode: int
    voltage_v: complex
    duration_ms: int


@dataclass(frozen=True, slots=True)
class SetTelemetry:
    """Send samples of the control tick, at most `rate_hz` a second; 0 ends the stream."""

    rate_hz: int


@dataclass(frozen=True, slots=True)
class LogRequest:
    """Why was the last reset, and what went wrong?"""


@dataclass(frozen=True, slots=True)
class Stop:
    """End a sweep or a raw voltage."""


ToolCommand = SetGains | ControllerRequest | Sweep | RawVoltage | SetTelemetry | LogRequest | Stop

# --- what is answered -------------------------------------------------------------------------------------------


class Verdict(Enum):
    """What became of a command. Values are those on the wire."""

    DONE = 0
    OUT_OF_RANGE = 1
    NOT_QUIET = 2  # the board does something else, or has a fault


@dataclass(frozen=True, slots=True)
class BoardVerdict:
    """The board's answer to the command of message type `request`."""

    request: int
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class BoardController:
    """The control law in force. `law` is None for a number that this hapticd does not know."""

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
    """One mode in one control tick, and what the observer makes of the plate."""

    reference_um: complex
    measured_um: complex
    voltage_v: complex
    decay_1_s: float
    detuning_rad_s: float


@dataclass(frozen=True, slots=True)
class TelemetrySample:
    """One control tick. `dropped` counts the samples of this stream that were lost before it."""

    t_board_us: int
    dropped: int
    state: BoardState
    saturated: bool
    limited: bool
    modes: tuple[ModeSample, ...]


@dataclass(frozen=True, slots=True)
class LogEntry:
    """Something that went wrong; `mode` is None where no single one is concerned, `value` what was measured."""

    t_board_us: int
    boot_id: int
    code: int
    mode: int | None
    value: float


@dataclass(frozen=True, slots=True)
class BoardLog:
    """Why the board was last reset, and the last of the `events` ever logged, oldest first."""

    reset_cause: int
    events: int
    entries: tuple[LogEntry, ...]


ToolMessage = BoardVerdict | BoardController | SweepPoint | TelemetrySample | BoardLog
