"""A bare rig at its largest open-loop voltage: how straight its chains are; then its plate against the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import Sweep
from ...board_values import ModeCalibration
from ...design.commissioning import plate
from ...design.commissioning.findings import Diagnosis, Judgement, PlateDesign
from ...design.wiring import AmplifierSweep, fit_wiring
from ...values import FloatArray
from ..firmware.conversation import Conversation
from ..firmware.sweep import measured_again
from . import measure, pictures
from .bench import Bench, bench_step, design_of

POINTS = 25
NEAR_HZ = 10.0  # to either side of a resonance, where limits are measured
SEEN_UM = 0.005  # least amplitude at a tenth of the volts that shows whether a chain is straight


async def _limits(bench: Bench) -> Judgement:
    async with bench.board() as board:
        design = await design_of(board)
        plan = measure.short_plan(design, measure.VOLTS_FRAC * design.v_limit_v)
        try:
            found = fit_wiring(await measure.swept(board, replace(plan, points=max(POINTS, plan.points))))
            modes = found.calibrations()  # raises where a mode has no resonance that a calibration can hold
        except ValueError as error:
            return Judgement("", (Diagnosis(str(error)),))
        straight = await _straight(board, design, modes)
    if not straight.is_passed:
        return straight
    judged = plate.judge_resonance(modes, found.fits, design)
    return Judgement(f"{judged.passed} {straight.passed}", judged.findings, (*judged.figures, *straight.figures))


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


STEP = bench_step(
    "limits",
    4,
    "measure a tenth and all of the open-loop voltage, and compare the plate with the design",
    "Hands off, the plate on its stamps only: up to a fifth of the voltage at each resonance.",
    pictures.ANSWER,
    _limits,
    back_to="wires",
)
