"""Sweep each amplifier of the board, fit all modes and wires, and propose a drive frequency.

A narrow or slow resonance, or one near the band's edge, is swept a second time around itself. Last comes a wide and
coarse sweep, for modes that the loop may make swing.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import ControllerRequest, Sweep
from ...board_values import BoardCalibration, BoardController, BoardHello, ModeCalibration
from ...design.far_modes import with_far_modes
from ...design.resonance import Resonance, largest_voltage_v, propose_drive_hz, voltage_v
from ...design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring
from ...errors import DeviceError
from ...files import calibration
from ...formats.mode_map import SweptModes, write_swept
from ...sim.board.board import PLATE_MODES_MAX
from .. import glass
from ..firmware import sweep
from ..firmware.conversation import Conversation
from ..firmware.sweep import ModeSweep
from ..progress import progress_bar
from .bench import Bench, add_board, at_bench
from .step import PICTURE, Figure, Finding, FoundSettings, Outcome, Step, Verdict, add_config, judge
from .trial import NO_REMARK, Tried, try_out

CALIBRATION_FILE, SWEEP_FILE = "calibration.toml", "sweep.npz"

CLEAN_FRAC, USABLE_FRAC = 0.05, 0.2  # residual of the circle over the largest response
ENOUGH = 1.01  # times the amplifiers' voltage: a sweep is no more exact
WORTH_MOVING = 1.1  # times the voltage at the best drive
DRIVEN_FRAC = 0.2  # of a mode's strongest amplifier: one that drives it too
POINTS_IN_WIDTH = 5  # a resonance with fewer in f / Q is swept again
BESIDE_HZ = 50.0  # beyond the outermost mode
WIDTHS = 2.0  # of f / Q to either side, the second time
DWELL_DECAYS = 12.0  # time constants of the mode; the board discards the first half: 0.2 % remains
PIECE_POINTS = 7  # of a sweep: lost when the board ends it
TRIES = 8  # of a piece that the board ends
WIDE_POINTS = 101  # of the widest sweep, for modes outside


class Drives(NamedTuple):
    """The best drive frequency, the largest voltage at the board's drive and at the best one, and the drive to be set:
    the best one where it is worth moving there, and the board can, else None."""

    best_hz: float
    now_v: float
    best_v: float
    set_hz: float | None


@dataclass(frozen=True, slots=True)
class MeasuredModes:
    """Each mode as its strongest amplifier shows it, its calibration with the wires, a sentence per wrong wire, the
    frequencies of parasitic modes, what the loop makes of all this, and all modes of narrow and wide sweeps."""

    sweeps: tuple[ModeSweep, ...]
    modes: tuple[ModeCalibration, ...]
    wrong_wires: tuple[str, ...] = ()
    parasitic_hz: tuple[float, ...] = ()
    trial: Tried = NO_REMARK
    shown: SweptModes | None = None


def run(options: argparse.Namespace) -> Verdict:
    """Run the step on the board named by `options`. Raises HapticdError."""
    with at_bench(options) as bench:
        hello, measured = bench.run(_sweep_on(bench, options))
    sweep.draw(measured.sweeps, options.out / "resonance.png", "simulated" if options.sim else "", **PICTURE)
    found = BoardCalibration(measured.modes, drives_of(hello, measured.modes).set_hz)
    calibration.save(options.out / CALIBRATION_FILE, found)
    if measured.shown is not None:
        write_swept(options.out / SWEEP_FILE, measured.shown)
    law = {"controller": measured.trial.controller} if measured.trial.controller else {}
    simulated = glass.settings(glass.chosen(options)) if options.sim else {}
    settings = {"device": {**bench.device, **law, "calibration_file": CALIBRATION_FILE}, **simulated}
    return verdict(hello, measured, settings, is_simulated=options.sim)


async def _sweep_on(bench: Bench, options: argparse.Namespace) -> tuple[BoardHello, MeasuredModes]:
    """Sweep the band given, or that of the modes that the board expects and some beyond."""
    async with bench.board() as board:
        models = (await board.ask(ControllerRequest(), BoardController)).models
        farthest_hz = max(abs(model.detuning_rad_s) for model in models) / (2.0 * math.pi)
        plan = sweep.planned(board.hello, options, max(sweep.BAND_HZ, farthest_hz + BESIDE_HZ))
        return board.hello, await sweep_modes(board, plan)


async def sweep_modes(board: Conversation, plan: Sweep) -> MeasuredModes:
    """Sweep every amplifier by the same plan, again where that was too coarse for a mode, and as widely as the board
    can; return the calibrations, tried against the loop. Raises DeviceError, also if no loop would hold."""
    amplifiers = range(board.hello.modes)
    swept = [await _swept(board, [replace(plan, mode=amplifier)]) for amplifier in amplifiers]
    try:
        found = fit_wiring(swept)
        closer = [_closer(plan, found, amplifier, board.hello) for amplifier in amplifiers]
        if any(closer):
            swept = [await _swept(board, again) if again else one for again, one in zip(closer, swept, strict=True)]
            found = fit_wiring(swept)
        modes = found.calibrations()
    except ValueError as error:
        raise DeviceError(str(error)) from None
    dwell_ms = max(_dwell_ms(fit.frequency_hz / fit.q_factor) for fit in found.fits)  # modes settle between points
    wide = Sweep(0, *_bounds_hz(board.hello), WIDE_POINTS, dwell_ms, plan.voltage_v)
    around = [await _swept(board, [replace(wide, mode=amplifier)]) for amplifier in amplifiers]
    driven_hz = drives_of(board.hello, modes).set_hz or board.hello.drive_hz
    wider = with_far_modes(found, [*swept, *around], PLATE_MODES_MAX - len(modes))
    trial = try_out(swept, found, modes, board.hello, driven_hz, wider)
    sweeps = []
    for mode, fit in enumerate(found.fits):
        own = swept[found.strongest(mode)]
        sweeps.append(ModeSweep(mode, own.frequency_hz, found.modal(mode, own), fit))
    wrong, parasitic_hz, shown = found.wrong_wires(), found.parasitic_hz(), SweptModes(*wider.swept())
    return MeasuredModes(tuple(sweeps), tuple(modes), tuple(wrong), tuple(parasitic_hz), trial, shown)


def _bounds_hz(hello: BoardHello) -> tuple[float, float]:
    return hello.drive_hz - protocol.SWEEP_OFFSET_MAX_HZ, hello.drive_hz + protocol.SWEEP_OFFSET_MAX_HZ


def _dwell_ms(width_hz: float) -> int:
    return min(math.ceil(1e3 * DWELL_DECAYS / (math.pi * width_hz)), protocol.SWEEP_DWELL_MAX_MS)


def _closer(plan: Sweep, found: MeasuredWiring, amplifier: int, hello: BoardHello) -> list[Sweep]:
    """Return sweeps of an amplifier around each mode that it drives, none if the plan was fine enough for all."""
    own = replace(plan, mode=amplifier)
    driven = abs(found.drives)[:, amplifier] > DRIVEN_FRAC * abs(found.drives).max(axis=1)
    plans = [refined(own, fit, hello) for fit, is_driven in zip(found.fits, driven, strict=True) if is_driven]
    return [one or own for one in plans] if any(plans) else []


async def _swept(board: Conversation, plans: Sequence[Sweep]) -> AmplifierSweep:
    """Sweep one amplifier piece by piece: the board may end one, which is repeated alone."""
    parts = [piece for plan in plans for piece in pieces(plan)]
    points = []
    with progress_bar(f"sweeping amplifier {plans[0].mode}") as progress:
        for done, piece in enumerate(parts, 1):
            points += await sweep.measured_again(board, piece, TRIES)
            progress(done / len(parts))
    return AmplifierSweep.of(plans[0].mode, points)


def pieces(plan: Sweep) -> list[Sweep]:
    """Split the plan into sweeps of about PIECE_POINTS each, at the same frequencies."""
    frequency_hz = np.linspace(plan.start_hz, plan.stop_hz, plan.points).tolist()
    count = max(plan.points // PIECE_POINTS, 1)
    edges = [place * plan.points // count for place in range(count + 1)]
    return [
        replace(plan, start_hz=frequency_hz[first], stop_hz=frequency_hz[end - 1], points=end - first)
        for first, end in pairwise(edges)
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


def drives_of(hello: BoardHello, modes: Sequence[ModeCalibration]) -> Drives:
    """Return the drive at which the largest voltage for full amplitude is least, compared with the board's."""
    best_hz = propose_drive_hz(modes, hello.w_limit_um)
    now_v, best_v = (largest_voltage_v(modes, drive_hz, hello.w_limit_um) for drive_hz in (hello.drive_hz, best_hz))
    is_near = abs(best_hz - hello.drive_hz) <= protocol.DRIVE_MOVE_MAX_HZ
    return Drives(best_hz, now_v, best_v, best_hz if is_near and now_v > WORTH_MOVING * best_v else None)


def verdict(hello: BoardHello, measured: MeasuredModes, settings: FoundSettings, *, is_simulated: bool) -> Verdict:
    """Judge the sweeps, the wires, and the board's drive and amplifiers."""
    best_hz, now_v, best_v, set_hz = drives_of(hello, measured.modes)
    both = zip(measured.sweeps, measured.modes, strict=True)
    figures = [figure for one, mode in both for figure in _figures(one, mode, hello)]
    figures += [Figure("parasitic mode", frequency_hz, "Hz") for frequency_hz in measured.parasitic_hz]
    undriven_hz = () if measured.shown is None else measured.shown.frequency_hz[len(measured.modes) :].tolist()
    figures += [Figure("undriven mode, to scan as well", hz, "Hz") for hz in undriven_hz]
    figures += [
        Figure("drive now", hello.drive_hz, "Hz"),
        Figure("drive proposed", best_hz, "Hz"),
        Figure("largest voltage now", now_v, "V"),
        Figure("largest voltage proposed", best_v, "V"),
    ]
    warnings = [*measured.wrong_wires, *filter(None, [measured.trial.sentence])]
    if best_v > ENOUGH * hello.v_limit_v:
        warnings.append(
            f"Full amplitude of all modes takes {best_v:.0f} V, and the amplifiers end at {hello.v_limit_v:.0f}."
        )
    if now_v > WORTH_MOVING * best_v:
        remedy = "set DRIVE_HZ in the firmware" if set_hz is None else "the calibration file sets it"
        warnings.append(
            f"At {best_hz:.1f} Hz full amplitude would take {best_v:.0f} V instead of {now_v:.0f}: {remedy}."
        )
    findings = [finding for one in measured.sweeps for finding in _findings(one)]
    outcome, sentence = judge(
        [*findings, *((Outcome.WARN, warning) for warning in warnings)],
        f"{len(measured.sweeps)} clean circles; the drive of {hello.drive_hz:.1f} Hz lies "
        f"{abs(hello.drive_hz - best_hz):.1f} Hz off the best one.",
    )
    return Verdict("resonance", outcome, sentence, tuple(figures), settings, is_simulated)


def _figures(one: ModeSweep, mode: ModeCalibration, hello: BoardHello) -> list[Figure]:
    found, name, limit_um = one.fit, f"mode {one.mode}", hello.w_limit_um[one.mode]
    return [
        Figure(f"{name} resonance", found.frequency_hz, "Hz"),
        Figure(f"{name} quality", found.q_factor, ""),
        Figure(f"{name} detuning", found.frequency_hz - hello.drive_hz, "Hz"),
        Figure(f"{name} gain", mode.gain_um_per_v_s, "um/(V s)"),
        Figure(f"{name} loop phase", math.degrees(found.loop_phase_rad), "degrees"),
        Figure(f"{name} residual", 100.0 * found.residual_frac, "%"),
        Figure(f"{name} voltage for {limit_um:g} um", voltage_v(mode, hello.drive_hz, limit_um), "V"),
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
    sweep.add_arguments(parser)
    parser.set_defaults(mode=0)  # the sweep is planned for the first mode and repeated for the others


STEP = Step(
    name="resonance",
    order=6,
    summary="sweep each amplifier of the board; fit modes, wires and drive (stop the service first)",
    example="--port /dev/ttyACM0 --out DIR",
    arguments=(add_board, add_config, _add_sweep, glass.add_arguments),
    check=lambda _: None,
    run=run,
    files=(CALIBRATION_FILE, SWEEP_FILE),
    back_to="wires",
)
