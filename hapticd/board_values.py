"""The vocabulary between the service and its board: what is said to it, what it says, and how it is told its modes.

Units and conventions are those of `hapticd.values`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from .values import SafeDrive

# --- what was measured of the plate's modes ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ModeCalibration:
    """One mode as a sweep found it; `loop_phase_rad` is what amplifier, electrodes and sensor add to the loop."""

    mode: int
    frequency_hz: float
    q_factor: float
    gain_um_per_v_s: float
    loop_phase_rad: float

    def model(self, drive_hz: float) -> ModeModel:
        """The same in the frame that rotates at `drive_hz`."""
        return ModeModel(
            decay_1_s=math.pi * self.frequency_hz / self.q_factor,
            detuning_rad_s=2.0 * math.pi * (self.frequency_hz - drive_hz),
            gain_um_per_v_s=self.gain_um_per_v_s,
            loop=complex(math.cos(self.loop_phase_rad), math.sin(self.loop_phase_rad)),
        )


# --- what is said to the board ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class HelloRequest:
    """Who are you? The board zeroes its output and forgets earlier frames."""


@dataclass(frozen=True, slots=True)
class SelectController:
    """Choose the board's control law: "pi" (the paper's four), "pi_ff" (feed-forward) or "deadbeat" (observer)."""

    name: str


@dataclass(frozen=True, slots=True)
class ModeModel:
    """One mode as the board's controller believes it to be; `loop` is the loop's constant phase as a unit phasor."""

    decay_1_s: float
    detuning_rad_s: float
    gain_um_per_v_s: float
    loop: complex


@dataclass(frozen=True, slots=True)
class SetModel:
    """What was measured of one mode, for the board to control it by."""

    mode: int
    model: ModeModel


@dataclass(frozen=True, slots=True)
class TimeRequest:
    """Asks for the board's clock; the stamp comes back."""

    t_host_ns: int


class ReferenceFrame(NamedTuple):
    """A numbered drive with its start on the board's wrapped microsecond clock."""

    seq: int
    t_apply_us: int
    drive: SafeDrive


@dataclass(frozen=True, slots=True)
class KeepAlive:
    """The host lives and frame `seq` stands."""

    seq: int


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Leave a latched fault."""


BoardCommand = HelloRequest | SelectController | SetModel | TimeRequest | ReferenceFrame | KeepAlive | ClearFault


# --- what the board says ------------------------------------------------------------------------------------------


class BoardState(Enum):
    """The firmware's own state. Values are those on the wire."""

    QUIET = 0  # no trusted stream of frames: output ramped to zero
    LIVE = 1  # following references
    FAULT = 2  # latched: silent until cleared
    TOOL = 3  # a sweep or a raw voltage of a person's drives the plate


@dataclass(frozen=True, slots=True)
class BoardHello:
    """What the board says of itself at the handshake."""

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


@dataclass(frozen=True, slots=True)
class BoardStatus:
    """The board's report after each reference frame and ten times a second otherwise.

    Times are the board's wrapped 32-bit microseconds. `seq` is the last accepted frame, `t_received_us` when it
    came, `t_applied_us` when its first knot took effect (0 and `applied` False while it is pending).
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


@dataclass(frozen=True, slots=True)
class BoardTime:
    """Answer to a time request: the host's stamp given back, and the board's clock at receipt and at reply."""

    t_host_ns: int
    t_received_us: int
    t_sent_us: int


BoardMessage = BoardHello | BoardStatus | BoardTime
