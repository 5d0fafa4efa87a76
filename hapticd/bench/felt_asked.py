"""Friction as asked in the closed loop, by plate, number of modes and what is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..sim.fingers.scenarios import HALF_UM, REAL, SLIPPERY_UM, STICKY_UM, strokes
from ..sim.perfect import perfect
from ..sim.plate.glasses import FINGERTIP, WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.settings import Settings, paper_settings
from .leak_runs import SCENARIO, SECONDS, SEEDS, Alternative, Figures, FinishedRun, compared
from .sweeps import swept
from .tables import Table, finite_rows

CASES = (  # plate, modes, the slippery finger's target, reach of the modes relative to the plate's own
    *((FINGERTIP, modes, SLIPPERY_UM, 1.0) for modes in (4, 5, 6)),
    *((FINGERTIP, modes, HALF_UM, 1.0) for modes in (4, 5)),
    *((WIDE, 8, SLIPPERY_UM, reach) for reach in (1.0, 1.5)),
    (WIDE, 8, 0.7, 1.0),
    (WIDE, 6, SLIPPERY_UM, 1.0),
)
LOOP, CALIBRATED, PAPER = "loop", "calibrated", "paper"


def run(
    *,
    cases: Sequence[tuple[str, int, float, float]] = CASES,
    seeds: Sequence[int] = SEEDS,
    seconds: float = SECONDS,
) -> Table:
    """Compare plates, numbers of modes and targets, each with perfect knowledge and the paper's scheme."""
    rows = []
    for plate, modes, target_um, reach in cases:
        built = PlateSettings.of(plate, modes)
        each_um = np.broadcast_to(built.w_limit_um, modes) * reach
        settings = Settings(motion=REAL, plate=replace(built, w_limit_um=tuple(each_um.tolist())))
        build = partial(strokes, targets_um=(target_um, STICKY_UM))
        ways = {
            LOOP: Alternative(settings, build=build),
            CALIBRATED: Alternative(settings, measured=swept, build=build),
            PAPER: Alternative(paper_settings(settings), build=build),
        }
        found = dict(compared(ways, _figures, seeds=seeds, seconds=seconds, timed=False))
        shares = {"loop_frac": found[LOOP]["felt_frac"], "paper_frac": found[PAPER]["felt_frac"]}
        name = f"{plate} plate, {modes} modes, {target_um:g} um" + (f", reach x {reach:g}" if reach != 1.0 else "")
        rows.append((name, {**found[CALIBRATED], **shares}))
    return Table(
        name="felt_asked",
        title=f"leak: friction as asked, {SCENARIO} of real hands, W and 0, seeds {', '.join(map(str, seeds))}",
        default=rows[0][0],
        rows=finite_rows(rows),
        compared=("felt_frac",),
        notes=(
            "felt: share of time in which both fingers' friction is as asked; slip and still: errors of the slippery",
            "and the sticky finger; these and contrast after `hapticd calibrate resonance`; loop: felt before it",
            "perfect: felt with perfect knowledge; paper: by the paper's scheme",
        ),
    )


def _figures(finished: FinishedRun) -> Figures:
    score = finished.run.score
    if finished.name != CALIBRATED:
        return {"felt_frac": score.felt_frac}
    slippery, sticky = score.fingers
    return {
        "felt_frac": score.felt_frac,
        "perfect_frac": perfect(finished.run).score.felt_frac,
        "slip_error_jnd": slippery.error_jnd,
        "slip_error_95_jnd": slippery.error_95_jnd,
        "still_error_jnd": sticky.error_jnd,
        "still_error_95_jnd": sticky.error_95_jnd,
        "contrast": score.contrast,
    }
