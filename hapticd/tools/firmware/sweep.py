"""`hapticd firmware sweep`: measures a mode and fits its resonance."""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

import numpy as np

from ...board_values import BoardHello, BoardState, BoardStatus, ModeCalibration, Sweep, SweepPoint
from ...design.resonance import Resonance, fit_resonance
from ...errors import ConfigError, DeviceError, SweepEndedError, UsageError
from ...files import calibration
from ...wire import protocol
from . import text
from .conversation import Conversation

BAND_HZ = 100.0  # to either side of the drive
VOLTS_FRAC = 0.1  # of the board's limit
SPARE_S = 2.0  # how much longer than its dwells a sweep may take
LAST_POINTS_S = 0.5  # a full ring of them over a line of 9600 baud


async def run(board: Conversation, options: argparse.Namespace) -> None:
    """Sweep, show, fit, and draw or save if asked."""
    sweep = planned(board.hello, options)
    for path in filter(None, (options.save, options.plot)):  # what cannot be read or written is not worth a sweep
        if not path.absolute().parent.is_dir():
            raise ConfigError(f"{path}: its directory is missing: create it first.")
    saved = _saved(options.save, board.hello.modes)
    points = await measured(board, sweep, show=not options.json)
    found = fitted(points, sweep.mode)
    if options.json:
        print(text.as_json({"sweep": sweep, "points": points, "resonance": found}))
    else:
        print("\n" + text.resonance(sweep.mode, found, points))
    if options.plot is not None:
        from .picture import draw_sweep

        draw_sweep(points, sweep.mode, found, options.plot)
    if options.save is not None:
        others = [one for one in saved if one.mode != sweep.mode]
        calibration.save(options.save, [*others, found.calibration(sweep.mode)])


def planned(hello: BoardHello, options: argparse.Namespace) -> Sweep:
    """The sweep that was asked for, its gaps filled. Raises UsageError for what this board would refuse."""
    volts = VOLTS_FRAC * hello.v_limit_v if options.volts is None else options.volts
    start_hz = hello.drive_hz - BAND_HZ if options.start_hz is None else options.start_hz
    stop_hz = hello.drive_hz + BAND_HZ if options.stop_hz is None else options.stop_hz
    check_drive(hello, options.mode, volts)
    for name, f_hz in (("--from", start_hz), ("--to", stop_hz)):
        if not protocol.is_within(f_hz - hello.drive_hz, protocol.SWEEP_OFFSET_HZ):
            raise UsageError(
                f"{name} is {f_hz:g} Hz, but the board sweeps {protocol.SWEEP_OFFSET_HZ[1]:g} Hz at most to either "
                f"side of its drive, {hello.drive_hz:g} Hz."
            )
    return Sweep(options.mode, start_hz, stop_hz, options.points, options.dwell, volts)


def check_drive(hello: BoardHello, mode: int, volts: float) -> None:
    """Raises UsageError for a mode that this board does not have, or a voltage that it would refuse open loop."""
    if not 0 <= mode < hello.modes:
        raise UsageError(f"There is no mode {mode}: the board has modes 0 to {hello.modes - 1}.")
    limit_v = protocol.RAW_LIMIT_FRAC * hello.v_limit_v
    if not 0.0 < volts <= limit_v:
        raise UsageError(f"--volts is {volts:g}, but open loop the board gives more than 0 and at most {limit_v:g} V.")


async def measured(board: Conversation, sweep: Sweep, *, show: bool) -> list[SweepPoint]:
    """All points of the sweep, printed as they come if `show`. Raises DeviceError where some never come,
    SweepEndedError where the board ended it."""
    points: list[SweepPoint] = []
    loop = asyncio.get_running_loop()
    end_s = loop.time() + sweep.points * sweep.dwell_ms * 1e-3 + SPARE_S
    is_over = False
    with board.driving():
        await board.demand(sweep)
        if show:
            print(text.sweep_head(board.hello.modes))
        while loop.time() < end_s and (not points or points[-1].index + 1 < sweep.points):
            message = await board.hear(end_s - loop.time())
            if isinstance(message, SweepPoint):
                points.append(message)
                if show:
                    print(text.sweep_row(message), flush=True)
            elif isinstance(message, BoardStatus) and message.state in (BoardState.FAULT, BoardState.QUIET):
                is_over = True
                end_s = min(end_s, loop.time() + LAST_POINTS_S)  # a STATUS overtakes points on their way to the line
    if is_over and (not points or points[-1].index + 1 < sweep.points):
        raise SweepEndedError("The board ended the sweep: see `hapticd firmware info` for a fault or its log.")
    if len(points) < sweep.points:
        lost = sweep.points - len(points)
        raise DeviceError(f"{lost} of the sweep's points never came: take a longer --dwell, or a faster --baud.")
    return points


def fitted(points: list[SweepPoint], mode: int) -> Resonance:
    """The resonance in the mode's answers. Raises DeviceError where there is none."""
    frequency_hz = np.array([point.frequency_hz for point in points])
    try:
        return fit_resonance(frequency_hz, responses_um_per_v(points, mode))
    except ValueError as error:
        raise DeviceError(str(error)) from None


def responses_um_per_v(points: list[SweepPoint], mode: int) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """What the mode answered (n,) for each volt."""
    return np.array([point.measured_um[mode] / point.voltage_v for point in points])


def _saved(path: Path | None, modes: int) -> tuple[ModeCalibration, ...]:
    if path is None or not path.exists():
        return ()
    if not path.is_file():
        raise ConfigError(f"{path}: is no file: name one for --save.")
    return calibration.load(path, modes)
