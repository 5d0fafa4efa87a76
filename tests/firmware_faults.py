"""Sensors, wires and loops that are not what the board believes: time to quiet, peaks and the fault of each.

Each cause holds for all of ASKED_UM, unless it says otherwise; its row has the worst of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from carrier_board import CarrierBoard, Converters

from hapticd import board_protocol as protocol
from hapticd.board_protocol import LogRequest
from hapticd.board_values import BoardLog
from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.sim.board.closed_loop import LIMIT_V, NOISE_UM, follow
from hapticd.sim.plate.wirings import IDENTITY, PAPER, wiring
from hapticd.values import FloatArray
from hapticd.wire import device

ASKED_UM = ((0.02, 0.0), (0.4, 0.1), (2.0, 0.0), (3.9, 0.5))
MUCH_UM = ((2.0, 2.0), (3.0, 3.0))
SECONDS, REACH_SECONDS = 0.6, 101.0
SWAP, INVERT, ONE_DEAD = np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([1.0, -1.0]), np.diag([0.0, 1.0])
DEAD = np.zeros((2, 2))

Run = tuple[Board, BoardTrace]


def board(
    name: str = IDENTITY,
    *,
    amplifiers: FloatArray | None = None,
    sensors: FloatArray | None = None,
    phase_deg: float = 0.0,
    gain: float = 1.0,
    damping: float = 1.0,
    control_hz: float = 2000.0,
    converters: Converters | None = None,
) -> Board:
    """Return a board that knows this wiring and the reference plate, on a plate that differs as stated."""
    wires, own = wiring(name, 2), BoardConfig(control_hz=control_hz)
    drives = gain * np.diag(own.gain_um_per_v_s) @ wires.drives
    through = (0.0 if converters is None else converters.loop_phase_rad(own.drive_hz),) * 2
    plate = PlateModel(
        decay_1_s=damping * np.array(own.decay_1_s),
        detuning_rad_s=np.array(own.detuning_rad_s),
        gain_um_per_v_s=drives if amplifiers is None else drives @ amplifiers,
        sensor=wires.senses if sensors is None else sensors @ wires.senses,
        noise_um=NOISE_UM if converters is None else 0.0,
        amplifier_limit_v=LIMIT_V,
        loop_phase_rad=(math.radians(phase_deg),) * 2 if converters is None else (),
    )
    known = replace(
        own,
        gain_um_per_v_s=tuple(wires.gain * np.array(own.gain_um_per_v_s)),
        drive=wires.drive,
        sense=wires.sense,
        loop_phase_rad=through,
    )
    return CarrierBoard(plate, config=known, converters=converters)


def held(driven: Board, asked_um: tuple[float, float], seconds: float = SECONDS) -> Run:
    """Ask for constant amplitudes."""
    hz = driven.config.control_hz
    modal_um = np.array(asked_um, complex)
    return driven, follow(driven, lambda _: [(0.0, modal_um)], round(seconds * hz), round(0.02 * hz))


def figures(run: Run) -> dict[str, float]:
    """Return time to quiet, infinite if the drive outlasts the run, the peaks, and the fault's code, 0 for none."""
    driven, trace = run
    voltage_v = np.abs(trace.voltage_v).max(axis=1)
    ticks = np.flatnonzero(voltage_v)
    is_quiet = ticks[-1] + 1 < len(trace)
    quiet_ms = 1e3 * (ticks[-1] - ticks[0] + 1) / driven.config.control_hz if is_quiet else math.inf
    return {
        "quiet_ms": float(quiet_ms),
        "peak_v": float(voltage_v.max()),
        "peak_um": float(np.abs(trace.plate_um).max()),
        "fault_code": float(fault(driven)),
    }


def fault(driven: Board) -> int:
    """Return the code of the last fault in the board's log, 0 for none."""
    driven.receive(device.encode(LogRequest()))
    logs = [message for message in device.Decoder().feed(driven.transmit()) if isinstance(message, BoardLog)]
    return max((entry.code for log in logs for entry in log.entries if entry.code in protocol.FAULTS), default=0)


def causes() -> Mapping[str, Callable[[], list[Run]]]:
    """Return the runs of each cause, by its name."""

    def any_asked(asked_um: tuple[tuple[float, float], ...] = ASKED_UM, **changes: object) -> Callable[[], list[Run]]:
        new: Callable[..., Board] = board
        return lambda: [held(new(**changes), one) for one in asked_um]

    clipped = Converters(offset_lsb=1700.0)
    return {
        "sensors dead": any_asked(sensors=DEAD),
        "one sensor dead": any_asked(sensors=ONE_DEAD),
        "sensors inverted": any_asked(sensors=-np.eye(2)),
        "one sensor inverted": any_asked(sensors=INVERT),
        "one amplifier inverted, both modes": any_asked(MUCH_UM, amplifiers=INVERT, damping=2.0),
        "sensors swapped": any_asked(sensors=SWAP),
        "paper's wiring, sensor dead": any_asked(name=PAPER, sensors=ONE_DEAD),
        "paper's wiring, sensors swapped": any_asked(name=PAPER, sensors=SWAP),
        "paper's wiring, amplifiers swapped": any_asked(name=PAPER, amplifiers=SWAP),
        "paper's wiring, one inverted": any_asked(name=PAPER, amplifiers=INVERT),
        "phase 50 degrees": any_asked(phase_deg=50.0),
        "phase -50 degrees": any_asked(phase_deg=-50.0),
        "phase 80 degrees": any_asked(phase_deg=80.0),
        "phase 80 degrees, both modes": any_asked(MUCH_UM, phase_deg=80.0),
        "gain x2.5": any_asked(gain=2.5),
        "signal x2.5": any_asked(sensors=2.5 * np.eye(2)),
        "ADC clipped, 2 um": any_asked(((2.0, 0.0),), converters=clipped),
        "out of reach, 3.9 um": lambda: [held(board(damping=2.0, control_hz=500.0), (3.9, 0.0), REACH_SECONDS)],
    }


def row(runs: list[Run]) -> dict[str, float]:
    """Return the worst of each figure."""
    found = [figures(run) for run in runs]
    return {name: max(one[name] for one in found) for name in found[0]}
