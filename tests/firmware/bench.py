"""The firmware on a bench: the C core with a simulated plate, driven by the encoders that the daemon uses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from hapticd.board_protocol import BoardVerdict, ClearFault, CommandResult, Keepalive, LogRequest
from hapticd.board_values import BoardCommand, BoardLog, BoardMessage, BoardStatus
from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.sim.board.closed_loop import PHASE_S, follow, stepped
from hapticd.values import ComplexArray, Knot, LimitReason, SafeDrive
from hapticd.wire import device
from hapticd.wire.commands import encode
from hapticd.wire.framing import FrameSplitter

Kind = TypeVar("Kind")


def nominal_plate(config: BoardConfig, **changes: Any) -> PlateModel:
    """The plate as a board of this configuration knows it, without noise, but for `changes`."""
    plate = PlateModel(
        decay_1_s=np.array(config.decay_1_s),
        detuning_rad_s=np.array(config.detuning_rad_s),
        gain_um_per_v_s=np.diag(config.gain_um_per_v_s),
        sensor=np.eye(len(config.w_limit_um)),
        noise_um=0.0,
        amplifier_limit_v=config.v_limit_v,
    )
    return replace(plate, **changes)


def step_trace(board: Board, from_um: ComplexArray, to_um: ComplexArray) -> BoardTrace:
    """0.1 s of one reference, then 0.1 s of another."""
    ticks = round(PHASE_S * board.config.control_hz)
    return follow(board, stepped(from_um, to_um), 2 * ticks, ticks // 10)


def untouched(board: Board, ticks: int) -> BoardTrace:
    """So many ticks without a finger and without a listener."""
    modes = board.model.modes
    trace = BoardTrace(ticks, modes, modes)
    board.run(ticks, np.zeros((ticks, 0, modes)), np.zeros((ticks, 0)), trace)
    return trace


def constantly(*w_um: complex) -> Callable[[float], list[tuple[float, ComplexArray]]]:
    """For `follow`: these amplitudes, all the time."""
    return lambda _: [(0.0, np.array(w_um, complex))]


def quiet_after_ms(trace: BoardTrace) -> float:
    """From the beginning of a trace of 2 kHz to the last voltage in it; infinite if that is in its last tick."""
    last = np.flatnonzero(np.abs(trace.voltage_v).max(axis=1))[-1]
    return math.inf if last == len(trace) - 1 else float(last + 1) / 2


class Bench:
    """A board with its nominal plate, and the host's side of the line."""

    def __init__(self, *, noise_um: float = 0.0, t_start_us: int = 0, **config: Any) -> None:
        self.config = BoardConfig(**config)
        plate = nominal_plate(self.config, noise_um=noise_um)
        self.board = Board(plate, config=self.config, boot_id=0x1234, t_start_us=t_start_us)
        self.modes = plate.modes
        self.seq = 0
        self.messages: list[BoardMessage] = []
        self._decoder = device.Decoder()

    def say(self, line: bytes, at_us: int | None = None) -> tuple[BoardMessage, ...]:
        """Bytes to the board, and its answer."""
        self.board.receive(line, at_us)
        return self.listen(at_us)

    def listen(self, at_us: int | None = None) -> tuple[BoardMessage, ...]:
        messages = self._decoder.feed(self.board.transmit(at_us))
        self.messages += messages
        return messages

    def verdict(self, command: BoardCommand) -> CommandResult:
        """What the board says to a command."""
        line = encode(command)
        (request,) = FrameSplitter(512).feed(line)
        (answer,) = of_kind(BoardVerdict, self.say(line))
        assert answer.request == request[0]
        return answer.verdict

    def received(self, kind: type[Kind]) -> list[Kind]:
        """The messages of this kind so far."""
        return of_kind(kind, self.messages)

    def polyline(self, *knots: tuple[float, Sequence[complex]], t_apply_us: int | None = None) -> bytes:
        """The next reference frame: knots as (ms after its start, amplitudes), from now on unless said otherwise."""
        self.seq += 1
        drive = SafeDrive(0, tuple(Knot(round(ms * 1e6), tuple(w)) for ms, w in knots), LimitReason.NONE)
        return device.encode_reference(self.seq, drive, self.board.t_us if t_apply_us is None else t_apply_us)

    def constant(self, *w_um: complex) -> bytes:
        return self.polyline((0.0, w_um))

    def run(self, ticks: int) -> BoardTrace:
        trace = BoardTrace(ticks, self.modes, self.modes)
        untouched_run = np.zeros((ticks, 0, self.modes)), np.zeros((ticks, 0))
        done = 0
        while done < ticks:
            done += self.board.run(ticks - done, *untouched_run, trace, done, stop_on_transmit=True)
            self.listen()
        return trace

    def arm(self, *w_um: complex) -> None:
        """Three references at once and the 10 ms of ramp: LIVE at full drive when this returns."""
        w_um = w_um or (0j,) * self.modes
        for _ in range(3):
            self.say(self.constant(*w_um))
        self.run(20)

    def hold(self, ticks: int) -> BoardTrace:
        """Runs with a keep-alive every 20 ms."""
        parts = []
        for start in range(0, ticks, 40):
            self.say(device.encode(Keepalive(self.seq)))
            parts.append(self.run(min(40, ticks - start)))
        return joined(parts)

    def status(self) -> BoardStatus:
        """What the board says of itself now. (Clearing no fault is the way to ask.)"""
        return of_kind(BoardStatus, self.say(device.encode(ClearFault())))[-1]

    def log(self) -> BoardLog:
        (found,) = of_kind(BoardLog, self.say(encode(LogRequest())))
        return found


def of_kind(kind: type[Kind], messages: Sequence[object]) -> list[Kind]:
    return [message for message in messages if isinstance(message, kind)]


def joined(parts: Sequence[BoardTrace]) -> BoardTrace:
    trace = BoardTrace(0, parts[0].modes, parts[0].plate_modes)
    for name in BoardTrace.__slots__:
        setattr(trace, name, np.concatenate([getattr(part, name) for part in parts]))
    return trace
