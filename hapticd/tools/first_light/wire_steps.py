"""The steps before anything is driven by more than a volt, and those that find the wires."""

from __future__ import annotations

import numpy as np

from ...design.commissioning import plate, rest, wires
from ...design.commissioning.findings import Diagnosis, Judgement
from ...design.wiring import AmplifierSweep, fit_wiring
from . import measure, pictures
from .bench import Bench, design_of
from .step import PageResult, StepPage

CONFIG_FAULT = 6  # the board refuses its own configuration
SILENT_V_FRAC = 0.1  # of the voltage limit: for what shows nothing at a volt


async def _supply(bench: Bench) -> PageResult:
    person = bench.person
    async with bench.board() as board:
        modes = board.hello.modes
        readings = rest.MeterReadings(
            board_v=await person.read_supply(0),
            plus_v=await person.read_supply(1),
            minus_v=await person.read_supply(2),
            idle_v=tuple([await person.read_idle(sensor) for sensor in range(modes)]),
        )
        is_configured = (await measure.status(board)).fault_code != CONFIG_FAULT
        _, events = await measure.events(board)
        drives = is_configured and await measure.drives(board)
        interlock = None if drives else rest.interlock_of(events)
    fell = rest.SUPPLY in events
    return PageResult(rest.judge_supply(readings, interlock, is_configured=is_configured, supply_fell=fell))


async def _rest(bench: Bench) -> PageResult:
    async with bench.board() as board:
        design = await design_of(board)
        t_us, measured_um = await measure.at_rest(board)
    found = rest.at_rest(t_us, measured_um, design)
    return PageResult(rest.judge_rest(found, design, len(t_us)))


async def _answers(bench: Bench) -> PageResult:
    async with bench.board() as board:
        design = await design_of(board)
        outputs_v = []
        for amplifier in range(board.hello.modes):
            async with measure.raw(board, amplifier, measure.ASKED_V):
                outputs_v.append(await bench.person.read_output(amplifier, measure.ASKED_V))
            await measure.quiet(board)
        bench.outputs_v = tuple(outputs_v)
        sweeps = await measure.swept(board, measure.short_plan(design, measure.ASKED_V))
        if wires.is_elsewhere(sweeps, design):
            found = wires.judge_search(await measure.swept(board, measure.search_plan(design)), design)
            if found is not None:
                return PageResult(Judgement("", (found,)), _drawn(sweeps))
        shares = wires.shares_of(wires.stacked(sweeps), design)
        if shares.diagonal().min() < wires.SILENT and shares.max() < wires.STRONG:
            sweeps = await measure.swept(board, measure.short_plan(design, SILENT_V_FRAC * design.v_limit_v))
    judgement = wires.judge_answers(sweeps, design, bench.outputs_v, measure.ASKED_V)
    shares = wires.shares_of(wires.stacked(sweeps), design)
    return PageResult(judgement, pictures.matrix(shares, "sensor", "amplifier"))


def _drawn(sweeps: list[AmplifierSweep]) -> str:
    own = [np.abs(sweep.response_um_per_v[:, sweep.amplifier]) * 1e3 for sweep in sweeps]
    return pictures.chart(sweeps[0].frequency_hz, own, "nm/V, each amplifier by its own sensor")


async def _polarity(bench: Bench) -> PageResult:
    async with bench.board() as board:
        design = await design_of(board)
        sweeps = await measure.swept(board, measure.short_plan(design, measure.VOLTS_FRAC * design.v_limit_v))
    bench.sweeps = sweeps
    outputs_v = bench.outputs_v or (None,) * design.modes
    return PageResult(wires.judge_polarity(sweeps, design, outputs_v), _drawn(sweeps))


async def _matrices(bench: Bench) -> PageResult:
    sweeps = bench.sweeps
    if sweeps is None:
        async with bench.board() as board:
            plan = measure.short_plan(design := await design_of(board), measure.VOLTS_FRAC * design.v_limit_v)
            sweeps = await measure.swept(board, plan)
    try:
        found = fit_wiring(sweeps)
    except ValueError as error:
        return PageResult(Judgement("", (Diagnosis(str(error)),)), _drawn(sweeps))
    moved = np.abs(found.senses @ found.drives)
    return PageResult(plate.judge_matrices(found), pictures.matrix(moved, "sensor", "amplifier"))


STEPS = (
    StepPage(
        "supply",
        "Supplies and idle levels",
        "Switch the supplies on. Read VDDA at the board's 3.3 V pin, both rails, and the DC at each ADC pin.",
        pictures.SUPPLY,
        _supply,
    ),
    StepPage(
        "rest",
        "Sensors at rest",
        "Take everything off the plate and keep still for two seconds.",
        pictures.REST,
        _rest,
    ),
    StepPage(
        "answers",
        "One amplifier at 1 V: does its own sensor answer?",
        "Goggles on, hands off the plate. With an oscilloscope, read each amplifier's output while it has 1 V.",
        pictures.ANSWER,
        _answers,
    ),
    StepPage(
        "polarity",
        "Polarity",
        "Hands off: each amplifier is swept at a tenth of its voltage.",
        pictures.POLARITY,
        _polarity,
        "answers",
    ),
    StepPage("matrices", "Which drive moves which sensor", "Hands off.", pictures.ANSWER, _matrices, "answers"),
)
