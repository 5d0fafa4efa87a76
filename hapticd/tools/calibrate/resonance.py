"""Sweep each amplifier of the board, fit all modes and wires, and propose a drive frequency.

A narrow or slow resonance, or one near the band's edge, is swept a second time around itself. Last comes a wide and
coarse sweep, for modes that the loop may make swing. `design.resonance` defines the criterion for the drive. One that
is worth moving is written to the calibration file, by which the daemon sets it.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import ControllerRequest, Sweep
from ...board_values import BoardCalibration, BoardController, BoardHello, ModeCalibration, SweepPoint
from ...design.resonance import MIN_POINTS, Resonance, largest_voltage_v, propose_drive_hz, voltage_v
from ...design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring
from ...errors import CalibrationError, DeviceError
from ...files import calibration
from .. import glass
from ..arguments import POSITIVE, whole
from ..firmware import sweep
from ..firmware.conversation import Conversation
from ..firmware.sweep import ModeSweep
from ..progress import Progress
from .bench import Bench, add_board, at_bench
from .step import Step, add_config
from .trial import NO_REMARK, Tried, try_out
from .verdict import PICTURE, Figure, Finding, FoundSettings, Outcome, Verdict, judge

CALIBRATION_FILE = "calibration.toml"
PICTURE_FILE = "resonance.png"

CLEAN_FRAC, USABLE_FRAC = 0.05, 0.2  # residual of the circle over the largest response
ENOUGH = 1.01  # times the amplifiers' voltage: a sweep is no more exact
WORTH_MOVING = 1.1  # times the voltage at the best drive
DRIVEN_FRAC = 0.2  # of a mode's strongest amplifier: one that drives it too
POINTS_IN_WIDTH = 5  # a resonance with fewer in f / Q is swept again
BESIDE_HZ = 50.0  # beyond the outermost mode
WIDTHS = 2.0  # of f / Q to either side, the second time
DWELL_DECAYS = 12.0  # time constants of the mode; the board discards the first half: 0.2 % remains
MOST_POINTS = 2001  # the board's limit
PIECE_POINTS = 7  # of a sweep: lost when the board ends it
TRIES = 8  # of a piece that the board ends
WIDE_POINTS = 101  # of the widest sweep, for modes outside


@dataclass(frozen=True, slots=True)
class MeasuredModes:
    """Each mode as its strongest amplifier shows it, its calibration with the wires, a sentence per wrong wire, the
    frequencies of parasitic modes, and what the loop makes of all this."""

    sweeps: tuple[ModeSweep, ...]
    modes: tuple[ModeCalibration, ...]
    wrong_wires: tuple[str, ...] = ()
    parasitic_hz: tuple[float, ...] = ()
    trial: Tried = NO_REMARK


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises CalibrationError, UsageError."""
    glass.chosen(options, is_simulated=options.sim)
    if not MIN_POINTS <= options.points <= MOST_POINTS:
        raise CalibrationError(f"--points: {options.points} is out of bounds, not {MIN_POINTS} .. {MOST_POINTS}.")


def run(options: argparse.Namespace) -> Verdict:
    """Run the step on the board named by `options`. Raises HapticdError."""
    with at_bench(options) as bench:
        hello, measured = bench.run(_sweep_on(bench, options))
    sweep.draw(measured.sweeps, options.out / PICTURE_FILE, **PICTURE)
    found = BoardCalibration(measured.modes, better_drive_hz(hello, measured.modes))
    calibration.save(options.out / CALIBRATION_FILE, found)
    simulated = glass.settings(glass.chosen(options)) if options.sim else {}
    settings = {
        "device": {**bench.device, **measured.trial.settings(), "calibration_file": CALIBRATION_FILE},
        **simulated,
    }
    return verdict(hello, measured, settings, is_simulated=options.sim)


async def _sweep_on(bench: Bench, options: argparse.Namespace) -> tuple[BoardHello, MeasuredModes]:
    async with bench.board() as board:
        return board.hello, await sweep_modes(board, sweep.planned(board.hello, options, await _band_hz(board)))


async def _band_hz(board: Conversation) -> float:
    """Return how far to either side of the drive the modes lie that the board expects, and some beyond."""
    models = (await board.ask(ControllerRequest(), BoardController)).models
    farthest_hz = max(abs(model.detuning_rad_s) for model in models) / (2.0 * math.pi)
    return max(sweep.BAND_HZ, farthest_hz + BESIDE_HZ)


async def sweep_modes(board: Conversation, plan: Sweep) -> MeasuredModes:
    """Sweep every amplifier by the same plan, and again where that was too coarse for a mode. Raises DeviceError."""
    points = [await _sweep(board, replace(plan, mode=amplifier)) for amplifier in range(board.hello.modes)]
    found = _fitted(points)
    closer = [await _closer(board, plan, found, amplifier) for amplifier in range(board.hello.modes)]
    if any(closer):
        points = [again or first for first, again in zip(points, closer, strict=True)]
        found = _fitted(points)
    around = await sweep_around(board, plan.voltage_v, found)
    return measured_modes(found, points, around, board.hello)


async def sweep_around(board: Conversation, volts: float, found: MeasuredWiring) -> list[list[SweepPoint]]:
    """Sweep every amplifier as widely as the board can, for modes that the loop may make swing. Raises DeviceError."""
    wide = _wide(volts, found, board.hello)
    return [await _sweep(board, replace(wide, mode=amplifier)) for amplifier in range(board.hello.modes)]


def _wide(volts: float, found: MeasuredWiring, hello: BoardHello) -> Sweep:
    """Return the widest sweep, of amplifier 0, in which the modes come to rest between points."""
    dwell_ms = max(_dwell_ms(fit.frequency_hz / fit.q_factor) for fit in found.fits)
    least_hz, most_hz = _bounds_hz(hello)
    return Sweep(0, least_hz, most_hz, WIDE_POINTS, dwell_ms, volts)


def _bounds_hz(hello: BoardHello) -> tuple[float, float]:
    return hello.drive_hz - protocol.SWEEP_OFFSET_MAX_HZ, hello.drive_hz + protocol.SWEEP_OFFSET_MAX_HZ


def _dwell_ms(width_hz: float) -> int:
    return min(math.ceil(1e3 * DWELL_DECAYS / (math.pi * width_hz)), protocol.SWEEP_DWELL_MAX_MS)


async def _closer(board: Conversation, plan: Sweep, found: MeasuredWiring, amplifier: int) -> list[SweepPoint]:
    """Sweep an amplifier around each mode that it drives, if the plan was too coarse for one of them."""
    driven = [
        fit for fit, row in zip(found.fits, abs(found.drives), strict=True) if row[amplifier] > DRIVEN_FRAC * row.max()
    ]
    plans = [refined(replace(plan, mode=amplifier), fit, board.hello) for fit in driven]
    if not any(plans):
        return []
    return [point for one in plans for point in await _sweep(board, one or replace(plan, mode=amplifier))]


async def _sweep(board: Conversation, plan: Sweep) -> list[SweepPoint]:
    """Sweep piece by piece: the board may end one, which is repeated alone."""
    points: list[SweepPoint] = []
    with Progress(f"sweeping amplifier {plan.mode}") as progress:
        for piece in pieces(plan):
            points += await sweep.measured_again(board, piece, TRIES)
            progress(len(points) / plan.points)
    return points


def _fitted(points: Sequence[Sequence[SweepPoint]]) -> MeasuredWiring:
    """Fit the sweeps of all amplifiers. Raises DeviceError if they do not show their modes."""
    try:
        return fit_wiring([AmplifierSweep.of(amplifier, swept) for amplifier, swept in enumerate(points)])
    except ValueError as error:
        raise DeviceError(str(error)) from None


def measured_modes(
    found: MeasuredWiring,
    points: Sequence[Sequence[SweepPoint]],
    around: Sequence[Sequence[SweepPoint]],
    hello: BoardHello,
) -> MeasuredModes:
    """Return the calibrations, tried against the loop, and each mode as its strongest amplifier shows it.

    Raises DeviceError if no loop would hold.
    """
    swept, wide = ([AmplifierSweep.of(k, one) for k, one in enumerate(all_points)] for all_points in (points, around))
    sweeps = []
    for mode, fit in enumerate(found.fits):
        own = swept[found.strongest(mode)]
        sweeps.append(ModeSweep(mode, own.frequency_hz, found.modal(mode, own), fit))
    try:
        modes = found.calibrations()
    except ValueError as error:
        raise DeviceError(str(error)) from None
    driven_hz = better_drive_hz(hello, modes) or hello.drive_hz
    trial = try_out(swept, found, modes, hello, driven_hz, wide)
    return MeasuredModes(tuple(sweeps), tuple(modes), tuple(found.wrong_wires()), tuple(found.parasitic_hz()), trial)


def pieces(plan: Sweep) -> list[Sweep]:
    """Split the plan into sweeps of about PIECE_POINTS each, at the same frequencies."""
    frequency_hz = np.linspace(plan.start_hz, plan.stop_hz, plan.points).tolist()
    count = max(plan.points // PIECE_POINTS, 1)
    edges = [place * plan.points // count for place in range(count + 1)]
    return [
        replace(plan, start_hz=frequency_hz[first], stop_hz=frequency_hz[end - 1], points=end - first)
        for first, end in pairwise(edges)
        if first < end
    ]


def refined(plan: Sweep, found: Resonance, hello: BoardHello) -> Sweep | None:
    """Return a sweep around the resonance, or None if `plan` resolved it."""
    width_hz = found.frequency_hz / found.q_factor
    step_hz = abs(plan.stop_hz - plan.start_hz) / max(plan.points - 1, 1)
    low_hz, high_hz = sorted((plan.start_hz, plan.stop_hz))
    is_surrounded = low_hz + width_hz / 2 <= found.frequency_hz <= high_hz - width_hz / 2
    if is_surrounded and step_hz * POINTS_IN_WIDTH <= width_hz and plan.dwell_ms >= _dwell_ms(width_hz):
        return None
    least_hz, most_hz = _bounds_hz(hello)
    reach_hz = WIDTHS * width_hz
    start_hz, stop_hz = max(found.frequency_hz - reach_hz, least_hz), min(found.frequency_hz + reach_hz, most_hz)
    if not start_hz < stop_hz:
        return None
    return replace(plan, start_hz=start_hz, stop_hz=stop_hz, dwell_ms=max(plan.dwell_ms, _dwell_ms(width_hz)))


def better_drive_hz(hello: BoardHello, modes: Sequence[ModeCalibration]) -> float | None:
    """Return the best drive if it is worth moving there, and the board can; else None."""
    best_hz = propose_drive_hz(modes, hello.w_limit_um)
    now_v, best_v = (largest_voltage_v(modes, drive_hz, hello.w_limit_um) for drive_hz in (hello.drive_hz, best_hz))
    is_near = abs(best_hz - hello.drive_hz) <= protocol.DRIVE_MOVE_MAX_HZ
    return best_hz if is_near and now_v > WORTH_MOVING * best_v else None


def verdict(hello: BoardHello, measured: MeasuredModes, settings: FoundSettings, *, is_simulated: bool) -> Verdict:
    """Judge the sweeps, the wires, and the board's drive and amplifiers."""
    sweeps, modes = measured.sweeps, measured.modes
    best_hz = propose_drive_hz(modes, hello.w_limit_um)
    now_v, best_v = (largest_voltage_v(modes, drive_hz, hello.w_limit_um) for drive_hz in (hello.drive_hz, best_hz))
    figures = [figure for one, mode in zip(sweeps, modes, strict=True) for figure in _figures(one, mode, hello)]
    figures += [Figure("parasitic mode", frequency_hz, "Hz") for frequency_hz in measured.parasitic_hz]
    figures += [
        Figure("drive now", hello.drive_hz, "Hz"),
        Figure("drive proposed", best_hz, "Hz"),
        Figure("largest voltage now", now_v, "V"),
        Figure("largest voltage proposed", best_v, "V"),
    ]
    findings = [finding for one in sweeps for finding in _findings(one)]
    warnings = [*measured.wrong_wires, *([measured.trial.sentence] if measured.trial.sentence else [])]
    if best_v > ENOUGH * hello.v_limit_v:
        warnings.append(
            f"Full amplitude of all modes takes {best_v:.0f} V, and the amplifiers end at {hello.v_limit_v:.0f}."
        )
    if now_v > WORTH_MOVING * best_v:
        remedy = "the calibration file sets it" if better_drive_hz(hello, modes) else "set DRIVE_HZ in the firmware"
        warnings.append(
            f"At {best_hz:.1f} Hz full amplitude would take {best_v:.0f} V instead of {now_v:.0f}: {remedy}."
        )
    outcome, sentence = judge(
        [*findings, *((Outcome.WARN, warning) for warning in warnings)],
        f"{len(sweeps)} clean circles; the drive of {hello.drive_hz:.1f} Hz lies "
        f"{abs(hello.drive_hz - best_hz):.1f} Hz off the best one.",
    )
    return Verdict("resonance", outcome, sentence, tuple(figures), settings, is_simulated)


def _figures(one: ModeSweep, mode: ModeCalibration, hello: BoardHello) -> list[Figure]:
    found, name = one.fit, f"mode {one.mode}"
    needed_v = voltage_v(mode, hello.drive_hz, hello.w_limit_um[one.mode])
    return [
        Figure(f"{name} resonance", found.frequency_hz, "Hz"),
        Figure(f"{name} quality", found.q_factor, ""),
        Figure(f"{name} detuning", found.frequency_hz - hello.drive_hz, "Hz"),
        Figure(f"{name} gain", mode.gain_um_per_v_s, "um/(V s)"),
        Figure(f"{name} loop phase", float(np.degrees(found.loop_phase_rad)), "degrees"),
        Figure(f"{name} residual", 100.0 * found.residual_frac, "%"),
        Figure(f"{name} voltage for {hello.w_limit_um[one.mode]:g} um", needed_v, "V"),
    ]


def _findings(one: ModeSweep) -> Iterator[Finding]:
    if not one.frequency_hz.min() <= one.fit.frequency_hz <= one.frequency_hz.max():
        yield Outcome.FAIL, f"Mode {one.mode} lies outside its sweep: give --from and --to around it."
    elif one.fit.residual_frac > USABLE_FRAC:
        yield Outcome.FAIL, f"Mode {one.mode} shows no resonance circle: check its sensor, amplifier and wiring."
    elif one.fit.residual_frac > CLEAN_FRAC:
        left = 100.0 * one.fit.residual_frac
        yield Outcome.WARN, f"Mode {one.mode} leaves {left:.0f} % off its circle: check for another mode nearby."


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--from", dest="start_hz", type=float, metavar="HZ", help="default: 100 Hz below the drive")
    parser.add_argument("--to", dest="stop_hz", type=float, metavar="HZ", help="default: 100 Hz above the drive")
    parser.add_argument("--points", type=whole(1), default=41, help="frequencies of a sweep (default 41)")
    parser.add_argument("--dwell", type=whole(1), default=100, metavar="MS", help="at each (default 100)")
    parser.add_argument("--volts", type=POSITIVE, help="on the amplifier (default: a tenth of the board's limit)")
    parser.set_defaults(mode=0)  # the sweep is planned for the first mode and repeated for the others


STEP = Step(
    name="resonance",
    order=6,
    summary="sweep each amplifier of the board; fit modes, wires and drive",
    todo="sweep each mode on the board: frequency, quality, gain, drive (stop the service first)",
    example="--port /dev/ttyACM0 --out DIR",
    arguments=(add_board, add_config, _add_sweep, glass.add_arguments),
    check=check,
    run=run,
    files=(CALIBRATION_FILE,),
    back_to="wires",
)
