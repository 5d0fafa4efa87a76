"""`hapticd firmware sweep`: measure a mode, fit its resonance, draw both."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import BoardState, Sweep
from ...board_values import BoardHello, BoardStatus, SweepPoint
from ...design.resonance import MIN_POINTS, Resonance, fit_resonance
from ...design.wiring import AmplifierSweep
from ...errors import DeviceError, SweepEndedError, UsageError
from .. import plotting
from ..arguments import POSITIVE, whole
from . import text
from .conversation import Conversation

BAND_HZ = 100.0  # to either side of the drive
VOLTS_FRAC = 0.1  # of the board's limit
SPARE_S = 2.0  # allowed beyond the sum of the dwells
LAST_POINTS_S = 0.5  # for a full ring of points over a line of 9600 baud
CURVE_POINTS = 400
TRIES = 4  # of a short sweep
STATUS_WITHIN_S = 0.5  # the board sends its status ten times a second
QUIET_WITHIN = 10  # status messages


@dataclass(frozen=True, slots=True)
class ModeSweep:
    """Responses W / V (n,) of one mode at frequencies (n,), and their fit."""

    mode: int
    frequency_hz: np.ndarray[tuple[int], np.dtype[np.float64]]
    response_um_per_v: np.ndarray[tuple[int], np.dtype[np.complex128]]
    fit: Resonance


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add a sweep's band, points, dwell and voltage, the same for all that sweep."""
    parser.add_argument("--from", dest="start_hz", type=float, metavar="HZ", help="default: 100 Hz below the drive")
    parser.add_argument("--to", dest="stop_hz", type=float, metavar="HZ", help="default: 100 Hz above the drive")
    points = whole(MIN_POINTS, protocol.SWEEP_POINTS_MAX)
    parser.add_argument("--points", type=points, default=41, help="frequencies (default 41)")
    parser.add_argument("--dwell", type=whole(1), default=100, metavar="MS", help="at each (default 100)")
    parser.add_argument("--volts", type=POSITIVE, help="on the amplifier (default: a tenth of the board's limit)")


async def run(board: Conversation, options: argparse.Namespace) -> None:
    """Sweep, print and fit; draw on request."""
    sweep = planned(board.hello, options)
    show = partial(text.show, is_all=options.plot is None)
    points = await measured(board, sweep, show=None if options.json else show)
    swept = fitted(points, sweep.mode)
    if options.json:
        show(text.as_json({"sweep": sweep, "points": points, "resonance": swept.fit}))
    else:
        show("\n" + text.resonance(sweep.mode, swept.fit, points))
    if options.plot is not None:
        draw([swept], options.plot)


def planned(hello: BoardHello, options: argparse.Namespace, band_hz: float = BAND_HZ) -> Sweep:
    """Return the requested sweep, by default `band_hz` to either side of the drive.

    Raises UsageError for one that this board would refuse.
    """
    volts = VOLTS_FRAC * hello.v_limit_v if options.volts is None else options.volts
    start_hz = hello.drive_hz - band_hz if options.start_hz is None else options.start_hz
    stop_hz = hello.drive_hz + band_hz if options.stop_hz is None else options.stop_hz
    check_drive(hello, options.mode, volts)
    for name, f_hz in (("--from", start_hz), ("--to", stop_hz)):
        if not abs(f_hz - hello.drive_hz) <= protocol.SWEEP_OFFSET_MAX_HZ:
            raise UsageError(
                f"{name} is {f_hz:g} Hz: the board sweeps {protocol.SWEEP_OFFSET_MAX_HZ:g} Hz at most to either "
                f"side of its drive, {hello.drive_hz:g} Hz."
            )
    return Sweep(options.mode, start_hz, stop_hz, options.points, options.dwell, volts)


def check_drive(hello: BoardHello, mode: int, volts: float) -> None:
    """Raise UsageError for a mode that this board lacks, or a voltage that it refuses open loop."""
    if not 0 <= mode < hello.modes:
        raise UsageError(f"There is no mode {mode}: the board has modes 0 to {hello.modes - 1}.")
    limit_v = protocol.RAW_LIMIT_FRAC * hello.v_limit_v
    if not 0.0 < volts <= limit_v:
        raise UsageError(f"--volts is {volts:g}: open loop the board takes more than 0 and at most {limit_v:g} V.")


async def measured(board: Conversation, sweep: Sweep, *, show: Callable[[str], None] | None = None) -> list[SweepPoint]:
    """Return all points of the sweep; `show` prints their lines as they arrive. Raises DeviceError for missing points,
    SweepEndedError if the board ended the sweep."""
    points: list[SweepPoint] = []
    loop = asyncio.get_running_loop()
    end_s = loop.time() + sweep.points * sweep.dwell_ms * 1e-3 + SPARE_S
    is_over = False
    with board.driving():
        await board.demand(sweep)
        if show is not None:
            show(text.sweep_head(board.hello.modes))
        while loop.time() < end_s and (not points or points[-1].index + 1 < sweep.points):
            message = await board.receive(end_s - loop.time())
            if isinstance(message, SweepPoint):
                points.append(message)
                if show is not None:
                    show(text.sweep_row(message))
            elif isinstance(message, BoardStatus) and message.state in (BoardState.FAULT, BoardState.QUIET):
                is_over = True
                end_s = min(end_s, loop.time() + LAST_POINTS_S)  # a STATUS overtakes points on their way to the line
    if is_over and (not points or points[-1].index + 1 < sweep.points):
        raise SweepEndedError("The board ended the sweep: this computer is busy, or `hapticd firmware info` says why.")
    if len(points) < sweep.points:
        lost = sweep.points - len(points)
        raise DeviceError(f"{lost} of the sweep's points never arrived: use a longer --dwell, or a faster --baud.")
    return points


async def measured_again(board: Conversation, sweep: Sweep, tries: int) -> list[SweepPoint]:
    """Return all points as `measured`, in up to `tries` sweeps: on a busy host the board may receive nothing for 50 ms,
    and ends one."""
    for _ in range(tries - 1):
        await _quiet(board)
        with contextlib.suppress(SweepEndedError):
            return await measured(board, sweep)
    await _quiet(board)
    return await measured(board, sweep)


async def each_swept(board: Conversation, plan: Sweep) -> list[AmplifierSweep]:
    """Return the responses to each amplifier in turn. Raises DeviceError."""
    return [
        AmplifierSweep.of(amplifier, await measured_again(board, replace(plan, mode=amplifier), TRIES))
        for amplifier in range(board.hello.modes)
    ]


async def _quiet(board: Conversation) -> None:
    """Wait until the previous sweep has ramped down; any other busy state makes the board refuse the next one."""
    for _ in range(QUIET_WITHIN):
        status = await board.wait_for(BoardStatus, STATUS_WITHIN_S)
        if status is None or status.state is not BoardState.TOOL:
            return


def fitted(points: Sequence[SweepPoint], mode: int) -> ModeSweep:
    """Fit the mode's responses. Raises DeviceError if they show no resonance."""
    frequency_hz = np.array([point.frequency_hz for point in points])
    response_um_per_v = np.array([point.measured_um[mode] / point.voltage_v for point in points])
    try:
        return ModeSweep(mode, frequency_hz, response_um_per_v, fit_resonance(frequency_hz, response_um_per_v))
    except ValueError as error:
        raise DeviceError(str(error)) from None


def draw(sweeps: Sequence[ModeSweep], path: Path, source: str = "", **style: int) -> None:
    """Draw amplitude and circle of all modes; `style` is that of `plotting.save`. Raises HapticdError."""
    figure, ((amplitude, circle),) = plotting.subplots(9.0, 4.0, 1, 2, source=source)
    for one in sweeps:
        curve_hz = np.linspace(one.frequency_hz.min(), one.frequency_hz.max(), CURVE_POINTS)
        fit, measured = 1e3 * one.fit.response(curve_hz), 1e3 * one.response_um_per_v
        label = f"mode {one.mode}: {one.fit.frequency_hz:.2f} Hz, Q {one.fit.q_factor:.0f}"
        (line,) = amplitude.plot(curve_hz, np.abs(fit), label=label)
        amplitude.plot(one.frequency_hz, np.abs(measured), ".", color=line.get_color())
        circle.plot(fit.real, fit.imag, color=line.get_color())
        circle.plot(measured.real, measured.imag, ".", color=line.get_color())
    amplitude.set(xlabel="frequency, Hz", ylabel="amplitude, nm/V", title="points: measured; lines: fit")
    amplitude.locator_params(axis="x", nbins=5)
    amplitude.legend(loc="lower center", fontsize=8)
    circle.set(xlabel="in phase, nm/V", ylabel="quadrature, nm/V", aspect="equal")
    plotting.save(figure, path, **style)
