"""The steps that drive: sweep, resonance, limits, dead-man, stop and loop."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import BoardState, Sweep
from ...board_values import BoardCalibration, ModeCalibration
from ...design.commissioning import drive, plate
from ...design.commissioning.findings import Diagnosis, Judgement, PlateDesign
from ...design.commissioning.rest import EMERGENCY_STOP
from ...design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring
from ...errors import DeviceError
from ...files import calibration
from ...values import FloatArray
from ..calibrate import folder
from ..calibrate import resonance as calibrate_resonance
from ..calibrate.trial import LAW, NO_REMARK, Tried, try_out
from ..calibrate.verdict import Outcome
from ..firmware.conversation import Conversation
from ..firmware.sweep import measured_again
from . import measure, pictures
from .bench import Bench, design_of
from .loop import Loop
from .step import PageResult, StepPage

POINTS = 25
NEAR_HZ = 10.0  # to either side of a resonance, where limits are measured
SEEN_UM = 0.005  # least amplitude at a tenth of the volts that shows whether a chain is straight
PULL_WITHIN_S, PLUG_WITHIN_S = 120.0, 120.0
RETRY_S = 0.5
PULLED_V_FRAC = 0.05  # of the voltage limit: what stands while the cable or the stop is pulled
SMALL_UM, LARGE_UM = 0.1, 1.0
TOUCHED_UM = 0.5


async def _fitted(
    bench: Bench, board: Conversation, design: PlateDesign
) -> tuple[MeasuredWiring, list[AmplifierSweep]]:
    """Sweep all modes and fit them. Raises ValueError, DeviceError."""
    plan = measure.short_plan(design, measure.VOLTS_FRAC * design.v_limit_v)
    bench.sweeps = await measure.swept(board, replace(plan, points=max(POINTS, plan.points)))
    bench.found = fit_wiring(bench.sweeps)
    return bench.found, bench.sweeps


async def _sweep(bench: Bench) -> PageResult:
    async with bench.board() as board:
        try:
            found, sweeps = await _fitted(bench, board, await design_of(board))
            found.calibrations()  # raises where a mode has no resonance that a calibration can hold
        except ValueError as error:
            return PageResult(Judgement("", (Diagnosis(str(error)),)))
    own = [np.abs(sweep.response_um_per_v[:, sweep.amplifier]) * 1e3 for sweep in sweeps]
    chart = pictures.chart(sweeps[0].frequency_hz, own, "nm/V, each mode by its own sensor")
    return PageResult(plate.judge_sweep(found), chart)


async def _resonance(bench: Bench) -> PageResult:
    async with bench.board() as board:
        design = await design_of(board)
        try:
            if bench.found is not None and bench.sweeps is not None:
                found, sweeps = bench.found, bench.sweeps
            else:
                found, sweeps = await _fitted(bench, board, design)
            modes = tuple(found.calibrations())
        except ValueError as error:
            return PageResult(Judgement("", (Diagnosis(str(error)),)))
        judgement = plate.judge_resonance(modes, found.fits, design)
        drive_hz = calibrate_resonance.better_drive_hz(board.hello, modes)
        trial = NO_REMARK
        if judgement.is_passed:
            try:
                trial = await _tried(board, sweeps, found, modes, drive_hz)
            except DeviceError:
                # A chain that clips bends the resonances as modes outside the sweep do.
                clipped = await _straight(board, design, modes)
                if clipped.is_passed:
                    raise
                return PageResult(clipped)
            judgement = replace(judgement, passed=f"{judgement.passed} {trial.sentence}".strip())
    if judgement.is_passed:
        calibration.save(bench.out / calibrate_resonance.CALIBRATION_FILE, BoardCalibration(modes, drive_hz))
        folder.save(bench.out, bench.verdict("resonance", Outcome.PASS, judgement, _settings(bench, trial)))
    return PageResult(judgement)


async def _tried(
    board: Conversation,
    sweeps: Sequence[AmplifierSweep],
    found: MeasuredWiring,
    modes: Sequence[ModeCalibration],
    drive_hz: float | None,
) -> Tried:
    """Try what was fitted against the loop, with all modes that a wide sweep shows. Raises DeviceError."""
    points = await calibrate_resonance.sweep_around(board, measure.VOLTS_FRAC * board.hello.v_limit_v, found)
    wide = [AmplifierSweep.of(amplifier, swept) for amplifier, swept in enumerate(points)]
    return try_out(sweeps, found, modes, board.hello, drive_hz or board.hello.drive_hz, wide)


def _settings(bench: Bench, trial: Tried) -> dict[str, dict[str, str | int]]:
    return {"device": {**bench.device, **trial.settings(), "calibration_file": calibrate_resonance.CALIBRATION_FILE}}


def _calibrated(bench: Bench, board: Conversation) -> BoardCalibration:
    """Return the calibration as it was written, by this run or by an earlier one. Raises HapticdError."""
    return calibration.load(bench.out / calibrate_resonance.CALIBRATION_FILE, board.hello.modes)


def _calibrated_loop(bench: Bench, board: Conversation) -> Loop:
    """Return the loop as the service closes it: with the calibration, and the law that bears the plate. Raises
    HapticdError."""
    law = folder.merged(folder.load(bench.out).values()).get("device", {}).get("controller", LAW)
    return Loop(board, _calibrated(bench, board), law)


async def _limits(bench: Bench) -> PageResult:
    async with bench.board() as board:
        design = await design_of(board)
        return PageResult(await _straight(board, design, _calibrated(bench, board).modes))


async def _straight(board: Conversation, design: PlateDesign, modes: Sequence[ModeCalibration]) -> Judgement:
    """Judge whether a tenth and all of the most volts that a tool may have move the plate in proportion."""
    least, most = [await _around(board, design, modes, frac) for frac in (0.1, 1.0)]
    volts = protocol.RAW_LIMIT_FRAC * design.v_limit_v
    seen = np.abs(least) * 0.1 * volts
    straight = np.where(seen > SEEN_UM, np.abs(most) / np.maximum(np.abs(least), 1e-12), np.nan)
    return plate.judge_limits(straight, volts * np.abs(most).diagonal(), design)


async def _around(
    board: Conversation, design: PlateDesign, modes: Sequence[ModeCalibration], frac: float
) -> FloatArray:
    """Return the largest responses (sensors, amplifiers) near each amplifier's own resonance, at a share of the most
    volts that a tool may have."""
    volts = frac * protocol.RAW_LIMIT_FRAC * design.v_limit_v
    columns = []
    for amplifier in range(design.modes):
        own_hz = modes[amplifier].frequency_hz
        plan = Sweep(amplifier, own_hz - NEAR_HZ, own_hz + NEAR_HZ, 3, 60, volts)
        swept = AmplifierSweep.of(amplifier, await measured_again(board, plan, measure.TRIES))
        columns.append(np.abs(swept.response_um_per_v).max(axis=0))
    return np.array(columns).T


async def _deadman(bench: Bench) -> PageResult:
    was_pulled = False
    async with bench.board() as board:
        volts = PULLED_V_FRAC * board.hello.v_limit_v
        is_silent = await measure.stops_in_silence(board, volts)
        if not is_silent:
            return PageResult(drive.judge_deadman(is_silent=False, was_pulled=False, is_quiet=False))
        boot_id, (before, _) = board.hello.boot_id, await measure.events(board)
        loop = asyncio.get_running_loop()
        try:
            async with measure.raw(board, 0, volts):
                await bench.person.pull_cable()
                end_s = loop.time() + PULL_WITHIN_S
                while loop.time() < end_s:
                    await board.receive(RETRY_S)
        except DeviceError:
            was_pulled = True
    if not was_pulled:
        return PageResult(drive.judge_deadman(is_silent=True, was_pulled=False, is_quiet=False))
    await bench.person.plug_cable()
    return PageResult(
        drive.judge_deadman(is_silent=True, was_pulled=True, is_quiet=await _came_back_quiet(bench, boot_id, before))
    )


async def _came_back_quiet(bench: Bench, boot_id: int, before: int) -> bool:
    """Return whether the board is quiet once its cable is plugged in again: logged by the dead-man, or switched off
    with the cable that feeds it. Raises DeviceError."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + PLUG_WITHIN_S
    while True:
        try:
            async with bench.board() as board:
                after, codes = await measure.events(board)
                is_logged = after > before and measure.TOOL_STOPPED in codes
                is_quiet = (await measure.status(board)).state is BoardState.QUIET
                return is_quiet and (is_logged or board.hello.boot_id != boot_id)
        except DeviceError:
            if loop.time() > end_s:
                raise
        await asyncio.sleep(RETRY_S)


async def _stop(bench: Bench) -> PageResult:
    async with bench.board() as board:
        before, _ = await measure.events(board)
        volts = PULLED_V_FRAC * board.hello.v_limit_v
        async with measure.raw(board, 0, volts):
            await bench.person.push_stop(True)
            stopped = await _ends(board, bench.press_s)
        after, codes = await measure.events(board)
        await bench.person.push_stop(False)
        await measure.quiet(board)
        drives_again = await measure.drives(board)
    return PageResult(
        drive.judge_stop(
            stopped=stopped, is_logged=after > before and EMERGENCY_STOP in codes, drives_again=drives_again
        )
    )


async def _ends(board: Conversation, within_s: float) -> bool:
    """Return whether the voltage ends within that; a board whose stop is pushed cannot drive again."""
    loop = asyncio.get_running_loop()
    end_s, quiet = loop.time() + within_s, 0
    while loop.time() < end_s:
        quiet = quiet + 1 if (await measure.status(board)).state is not BoardState.TOOL else 0
        if quiet >= 2:
            return True
    return False


async def _loop(bench: Bench, amplitude_um: float) -> PageResult:
    async with bench.board() as board:
        loop = _calibrated_loop(bench, board)
        await loop.begin()
        held = [
            await loop.hold(mode, min(amplitude_um, board.hello.w_limit_um[mode])) for mode in range(board.hello.modes)
        ]
        loop.rest()
    return PageResult(drive.judge_loop(held, loop.fault))


async def _small(bench: Bench) -> PageResult:
    return await _loop(bench, SMALL_UM)


async def _large(bench: Bench) -> PageResult:
    return await _loop(bench, LARGE_UM)


async def _touch(bench: Bench) -> PageResult:
    async with bench.board() as board:
        loop = _calibrated_loop(bench, board)
        await loop.begin()
        still = await loop.hold(0, TOUCHED_UM)
        await bench.person.touch_plate(True)
        touched = await loop.hold(0, TOUCHED_UM, bench.touch_s)
        await bench.person.touch_plate(False)
        loop.rest()
    judgement = drive.judge_touch(still.volts_v, touched.volts_v)
    faults = drive.judge_loop((), loop.fault).findings
    return PageResult(replace(judgement, findings=(*faults, *judgement.findings)))


FIRST = "answers"  # that a mended wire may change
STEPS = (
    StepPage(
        "sweep",
        "Sweep",
        "Hands off: each amplifier is swept at a tenth of its voltage.",
        pictures.ANSWER,
        _sweep,
        FIRST,
    ),
    StepPage(
        "resonance",
        "Resonance against the design",
        "Hands off, the plate on its stamps only.",
        pictures.ANSWER,
        _resonance,
        FIRST,
    ),
    StepPage(
        "limits", "Limits", "Hands off: a fifth of the voltage at each resonance.", pictures.ANSWER, _limits, FIRST
    ),
    StepPage(
        "dead-man",
        "The dead-man",
        "Pull the board's USB cable when asked; then plug it in again.",
        pictures.DEADMAN,
        _deadman,
    ),
    StepPage("stop", "The emergency stop", "Press the stop when asked; then release it.", pictures.STOP, _stop),
    StepPage("loop-0.1", "The loop at 0.1 um", "Hands off.", pictures.LOOP, _small, FIRST),
    StepPage("loop-1", "The loop at 1 um", "Hands off, goggles on.", pictures.LOOP, _large, FIRST),
)
TOUCH = StepPage(
    "touch",
    "Touch",
    "Rest a finger on the plate when asked, where the first mode moves most.",
    pictures.TOUCH,
    _touch,
)
