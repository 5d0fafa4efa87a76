"""A bare rig at its largest open-loop voltage: how straight its chains are; then its plate against the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ... import board_protocol as protocol
from ...board_protocol import Sweep
from ...board_values import ModeCalibration
from ...design.commissioning import plate
from ...design.commissioning.findings import Diagnosis, Judgement
from ...design.wiring import AmplifierSweep, fit_wiring
from ...values import FloatArray
from ..firmware.sweep import TRIES, VOLTS_FRAC, each_swept, measured_again
from .bench import BareRig, Bench, bench_step
from .wires import PICTURE, short_plan

POINTS = 25
NEAR_HZ = 10.0  # to either side of a resonance, where limits are measured
SEEN_UM = 0.005  # least amplitude at a tenth of the volts that shows whether a chain is straight


async def _limits(bench: Bench) -> Judgement:
    async with bench.board() as board:
        design = await board.design()
        plan = short_plan(design, VOLTS_FRAC * design.v_limit_v)
        try:
            found = fit_wiring(await each_swept(board, replace(plan, points=max(POINTS, plan.points))))
            modes = found.calibrations()  # raises where a mode has no resonance that a calibration can hold
        except ValueError as error:
            return Judgement("", (Diagnosis(str(error)),))
        volts = protocol.RAW_LIMIT_FRAC * design.v_limit_v  # the most that a tool may have
        least, most = [await _around(board, modes, frac * volts) for frac in (0.1, 1.0)]
    straight = np.where(least * 0.1 * volts > SEEN_UM, most / np.maximum(least, 1e-12), np.nan)
    judged = plate.judge_limits(straight, volts * most.diagonal())
    return plate.judge_resonance(found.fits, design).and_then(judged) if judged.is_passed else judged


async def _around(board: BareRig, modes: Sequence[ModeCalibration], volts: float) -> FloatArray:
    """Return the largest responses (sensors, amplifiers) near each amplifier's own resonance."""
    columns = []
    for amplifier, own in enumerate(modes):
        plan = Sweep(amplifier, own.frequency_hz - NEAR_HZ, own.frequency_hz + NEAR_HZ, 3, 60, volts)
        near = AmplifierSweep.of(amplifier, await measured_again(board, plan, TRIES))
        columns.append(np.abs(near.response_um_per_v).max(axis=0))
    return np.array(columns).T


STEP = bench_step(
    "limits",
    4,
    "measure a tenth and all of the open-loop voltage, and compare the plate with the design",
    "Hands off, the plate on its stamps only: up to a fifth of the voltage at each resonance.",
    PICTURE,
    _limits,
    back_to="wires",
)
