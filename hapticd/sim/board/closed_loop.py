"""Experiments on the closed loop: the firmware's own C against the plate model.

For `hapticd bench firmware`, the firmware's tests and the soak. Plates differ from the reference plate in quality,
damping and drift; the board is configured with the quality alone.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...values import ComplexArray, FloatArray, Knot, LimitReason, SafeDrive
from ...wire import device
from .board import (
    CHUNK_S,
    Board,
    BoardConfig,
    BoardTrace,
    PlateModel,
    reference_decay_1_s,
    reference_gain_um_per_v_s,
)

# of a frame that starts at an instant (s): ms after it, um
KnotsAt = Callable[[float], list[tuple[float, ComplexArray]]]

SETTLED_FRAC = 0.02
NOISE_UM = 0.00061  # one step of 14 bits over +-5 um
LIMIT_V = 150.0
PHASE_S = 0.1  # of an experiment: at rest, after the step, after the landing
LANDED_DAMPING = 1.5


@dataclass(frozen=True, slots=True)
class LoopPlate:
    """The true plate: `damping` times the decay that the board knows, resonances `detune_hz` off.

    `loop_phase_rad` is the constant phase of both loops, of which the board knows nothing.
    """

    quality: float = 500.0
    damping: float = 1.0
    detune_hz: float = 0.0
    loop_phase_rad: float = 0.0

    @property
    def decay_1_s(self) -> float:
        return self.damping * reference_decay_1_s(self.quality)[0]

    def bound_ms(self, amplitude_um: float) -> float:
        """Shortest settling time (2 %) of any control law: d|W|/dt <= g V - decay |W|; infinite if out of reach."""
        share = (1.0 - SETTLED_FRAC) * amplitude_um * self.decay_1_s
        share /= reference_gain_um_per_v_s(self.quality) * LIMIT_V
        return -1e3 / self.decay_1_s * math.log1p(-share) if share < 1.0 else math.inf

    def reaches(self, amplitude_um: float) -> bool:
        """Whether the amplifiers can hold this amplitude of the first mode."""
        demand_1_s = abs(complex(self.decay_1_s, 2 * math.pi * (self.detune_hz - 10.0)))
        return amplitude_um * demand_1_s <= 0.97 * reference_gain_um_per_v_s(self.quality) * LIMIT_V


@dataclass(frozen=True, slots=True)
class Law:
    """A control law at a control rate."""

    controller: str
    control_hz: float = 2000.0

    @property
    def tick_ms(self) -> float:
        return 1e3 / self.control_hz

    @property
    def phase_ticks(self) -> int:
        return round(PHASE_S * self.control_hz)

    def board(self, plate: LoopPlate, *, noise_um: float = NOISE_UM) -> Board:
        """A board with this law and that plate."""
        gain = reference_gain_um_per_v_s(plate.quality)
        config = BoardConfig(
            controller=self.controller,
            control_hz=self.control_hz,
            decay_1_s=reference_decay_1_s(plate.quality),
            gain_um_per_v_s=(gain, gain),
        )
        model = PlateModel(
            decay_1_s=plate.damping * np.array(config.decay_1_s),
            detuning_rad_s=np.array(config.detuning_rad_s) + 2 * np.pi * plate.detune_hz,
            gain_um_per_v_s=gain * np.eye(2),
            sensor=np.eye(2),
            noise_um=noise_um,
            amplifier_limit_v=LIMIT_V,
            loop_phase_rad=(plate.loop_phase_rad,) * 2,
        )
        return Board(model, config=config)

    def respond(self, plate: LoopPlate, amplitude_um: float) -> ComplexArray:
        """W_X (3 phases) each CHUNK_S from the first tick after the step on: 0 to `amplitude_um`, then fingers land and
        raise the decay by half of the bare plate's, then they lift."""
        ticks = self.phase_ticks
        landing_1_s = np.zeros((4 * ticks, 1))
        landing_1_s[2 * ticks + 1 : 3 * ticks + 1] = (LANDED_DAMPING - 1.0) * plate.decay_1_s
        on_x = np.tile([1.0, 0.0], (4 * ticks, 1, 1))

        knots = stepped(np.zeros(2, complex), np.array([amplitude_um, 0.0j]))
        trace = follow(self.board(plate), knots, 4 * ticks, ticks // 10, (on_x, landing_1_s))
        return between_ticks(trace, plate, landing_1_s[:, 0], self.tick_ms)[ticks:].ravel()


def between_ticks(trace: BoardTrace, plate: LoopPlate, contact_1_s: FloatArray, tick_ms: float) -> ComplexArray:
    """W_X (ticks, chunks of a tick) from each tick on, exact: a tick's voltage takes over after the first chunk."""
    decay_1_s, detuning_rad_s = plate.decay_1_s, 2.0 * math.pi * (plate.detune_hz - 10.0)
    rate_1_s = -(decay_1_s + np.append(contact_1_s[1:], 0.0)) + 1j * detuning_rad_s
    turn = -1j * cmath.exp(1j * plate.loop_phase_rad) * reference_gain_um_per_v_s(plate.quality)
    keep = np.exp(rate_1_s * CHUNK_S)
    new_um = turn * trace.voltage_v[:, 0] * (keep - 1.0) / rate_1_s  # what a chunk of a tick's voltage adds
    rows = [trace.plate_um[:, 0]]
    for chunk in range(round(1e-3 * tick_ms / CHUNK_S) - 1):
        rows.append(keep * rows[-1] + (new_um if chunk else np.append(0.0, new_um[:-1])))
    return np.stack(rows, axis=1)


class Response(NamedTuple):
    """Measures of a step and a landing; times in ms, the rest as fractions of the amplitude."""

    settling_ms: float
    overshoot_frac: float
    cross_axis_frac: float
    recovery_ms: float
    dip_frac: float


def measure(w_um: ComplexArray, amplitude_um: float, tick_ms: float, step_ms: float = CHUNK_S * 1e3) -> Response:
    """Measure the result of `Law.respond`, or of another in rows of `step_ms`."""
    phase = len(w_um) // 3
    stepped, landed = w_um[:phase], w_um[phase : 2 * phase]
    return Response(
        settling_ms=settling_ms(stepped, amplitude_um, tick_ms, step_ms),
        overshoot_frac=float(stepped.real.max()) / amplitude_um - 1.0,
        cross_axis_frac=float(np.abs(stepped.imag).max()) / amplitude_um,
        recovery_ms=max(settling_ms(landed, amplitude_um, 0.0, step_ms), 0.0),
        dip_frac=1.0 - float(np.abs(landed).min()) / amplitude_um,
    )


def settling_ms(w_um: ComplexArray, target_um: complex, tick_ms: float, step_ms: float | None = None) -> float:
    """Time after which the amplitude, in rows of `step_ms` or else of ticks, stays within 2 %; infinite if it does not.

    Counted from the instant at which the host asks; the board receives the step a tick later.
    """
    step_ms = tick_ms if step_ms is None else step_ms
    outside = np.flatnonzero(np.abs(w_um - target_um) > SETTLED_FRAC * abs(target_um))
    if len(outside) == 0:
        return 0.0
    return tick_ms + float(outside[-1] + 1) * step_ms if outside[-1] + 1 < len(w_um) else math.inf


def follow(
    board: Board,
    knots_at: KnotsAt,
    ticks: int,
    every: int,
    touch: tuple[FloatArray, FloatArray] | tuple[FloatArray, FloatArray, FloatArray] | None = None,
) -> BoardTrace:
    """Drive the board with the knots that `knots_at` gives for each frame.

    `touch` is phi (ticks, F, P), contact decay (ticks, F) and, if fingers detune, contact detuning (ticks, F) as in
    `Board.run`; without it no finger touches.
    """
    modes, plate_modes = board.model.modes, board.model.plate_modes
    phi, decay_1_s, *detuning_rad_s = touch or (np.zeros((ticks, 0, plate_modes)), np.zeros((ticks, 0)))
    contact_detuning_rad_s = detuning_rad_s[0] if detuning_rad_s else None
    trace = BoardTrace(ticks, modes, plate_modes)
    seq = 0
    for tick in range(0, ticks, every):
        knots = tuple(Knot(round(ms * 1e6), tuple(w)) for ms, w in knots_at(board.t_us * 1e-6))
        for _ in range(3 if tick == 0 else 1):  # a board trusts the third frame of a stream
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
            seq += 1
        due = min(every, ticks - tick)
        board.run(due, phi, decay_1_s, trace, tick, contact_detuning_rad_s=contact_detuning_rad_s)
    return trace


def stepped(from_um: ComplexArray, to_um: ComplexArray) -> KnotsAt:
    """One reference for PHASE_S, then another."""
    return lambda t_s: [(0.0, to_um if t_s > PHASE_S - 1e-4 else from_um)]
