"""The wires of a bare rig: does each amplifier move its own sensor, the right way round, and no other?"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import Sweep
from ...design.commissioning import plate, wires
from ...design.commissioning.findings import Diagnosis, Judgement, PlateDesign
from ...design.wiring import AmplifierSweep, fit_wiring
from ...values import FloatArray
from ..firmware.sweep import VOLTS_FRAC, each_swept
from .bench import BareRig, Bench, bench_step

ASKED_V = 1.0  # of the first voltage on a new amplifier
STEP_HZ, DWELL_MS = 15.0, 40  # of a short sweep: half of it settles, 4 time constants at Q 500
BESIDE_HZ = 120.0  # to either side of the outermost mode: good plates lie 40 Hz off
SEARCH_STEP_HZ, SEARCH_DWELL_MS = 20.0, 20
SILENT_V_FRAC = 0.1  # of the voltage limit: for what shows nothing at a volt
WIDTH, HEIGHT = 61, 8  # of a chart
PICTURE = """\
   DAC k --> amplifier k --+--> patch k ==+
                           |              | plate
                         scope            |
   ADC k <-------------------- sensor k ==+

   scope: 1 V peak at the patch, and its sign
          against the DAC's pin
"""
POLARITY = """\
   drive    /\\    /\\    /
           /  \\  /  \\  /
          /    \\/    \\/

   sensor     /\\    /\\     right: at resonance it
             /  \\  /  \\           lags by a quarter
            /    \\/    \\    inverted: it leads
"""


def short_plan(design: PlateDesign, volts: float) -> Sweep:
    """Return a sweep over all modes that the design expects, of amplifier 0."""
    low_hz, high_hz = min(design.frequency_hz) - BESIDE_HZ, max(design.frequency_hz) + BESIDE_HZ
    points = max(math.ceil((high_hz - low_hz) / STEP_HZ) + 1, 2 * design.modes + 3)
    return Sweep(0, low_hz, high_hz, points, DWELL_MS, volts)


def search_plan(design: PlateDesign) -> Sweep:
    """Return a sweep over all that the board can sweep."""
    reach_hz = protocol.SWEEP_OFFSET_MAX_HZ
    low_hz, high_hz = design.drive_hz - reach_hz, design.drive_hz + reach_hz
    points = math.ceil((high_hz - low_hz) / SEARCH_STEP_HZ) + 1
    return Sweep(0, low_hz, high_hz, points, SEARCH_DWELL_MS, VOLTS_FRAC * design.v_limit_v)


async def _wires(bench: Bench) -> Judgement:
    async with bench.board() as board:
        design = await board.design()
        outputs_v = []
        for amplifier in range(board.hello.modes):
            async with board.raw(amplifier, ASKED_V):
                outputs_v.append(await bench.person.read_output(amplifier, ASKED_V))
            await board.quiet()
        answers = await _answers(board, design, outputs_v)
        if not answers.is_passed:
            return answers
        sweeps = await each_swept(board, short_plan(design, VOLTS_FRAC * design.v_limit_v))
    _draw(sweeps)
    polarity = wires.judge_polarity(sweeps, design, outputs_v)
    if not polarity.is_passed:
        return polarity
    try:
        found = fit_wiring(sweeps)
    except ValueError as error:
        return Judgement("", (Diagnosis(str(error)),))
    return answers.and_then(polarity).and_then(plate.judge_matrices(found))


async def _answers(board: BareRig, design: PlateDesign, outputs_v: Sequence[float | None]) -> Judgement:
    """Sweep by a volt, all that the board can sweep where nothing answers, and by more volts what is silent."""
    sweeps = await each_swept(board, short_plan(design, ASKED_V))
    if wires.is_elsewhere(sweeps, design):
        found = wires.judge_search(await each_swept(board, search_plan(design)), design)
        if found is not None:
            _draw(sweeps)
            return Judgement("", (found,))
    shares = wires.shares_of(wires.stacked(sweeps), design)
    if shares.diagonal().min() < wires.SILENT and shares.max() < wires.STRONG:
        sweeps = await each_swept(board, short_plan(design, SILENT_V_FRAC * design.v_limit_v))
    return wires.judge_answers(sweeps, design, outputs_v, ASKED_V)


def _draw(sweeps: Sequence[AmplifierSweep]) -> None:
    own = [np.abs(sweep.response_um_per_v[:, sweep.amplifier]) * 1e3 for sweep in sweeps]
    print(chart(sweeps[0].frequency_hz, own, "nm/V, each amplifier by its own sensor"), flush=True)


def chart(x_hz: FloatArray, curves: Sequence[FloatArray], unit: str) -> str:
    """Return curves (n,) over frequencies (n,) as lines of text, the k-th drawn with the digit k."""
    most = float(np.max(curves)) or 1.0
    grid = np.full((HEIGHT, WIDTH), " ")
    columns = np.round((WIDTH - 1) * (x_hz - x_hz.min()) / np.ptp(x_hz)).astype(int)
    for k, curve in enumerate(curves):
        grid[HEIGHT - 1 - np.round((HEIGHT - 1) * curve / most).astype(int), columns] = str(k % 10)
    rows = [f"   |{''.join(row).rstrip()}" for row in grid]
    ends = f"   {x_hz.min():.0f} .. {x_hz.max():.0f} Hz"
    return "\n".join([f"   {most:.3g} {unit}", *rows, f"   +{'-' * WIDTH}", ends])


STEP = bench_step(
    "wires",
    3,
    "find out whether each amplifier moves its own sensor, the right way round",
    "Goggles on, hands off the plate. With an oscilloscope, read each amplifier's output while it has 1 V; then each "
    "is swept, at last at a tenth of its voltage.",
    PICTURE + "\n" + POLARITY,
    _wires,
    back_to="wires",
)
