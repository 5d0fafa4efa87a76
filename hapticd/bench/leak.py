"""The closed loop in lock-step runs, with one choice changed at a time.

The same trajectories, noise and plate for all; the firmware's C and the plate's true motion in the loop. A pass's time
is that of the whole way from report to frame, without the board.

    run        a sticky and a slippery finger: hapticd, its choices, the paper's scheme, perfect knowledge
    contact    the vibration over whole contacts, on three plates with two to eight modes, and with calibrated sensors
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..sim.fingers.pad_noise import PadNoise
from ..sim.fingers.scenarios import REAL
from ..sim.perfect import perfect
from ..sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import CONTACT_RADIUS_MM, Score
from ..sim.settings import Settings, paper_settings
from ..values import WEBER_FRAC
from .baselines import PREDICTORS
from .leak_runs import (
    DEFAULT,
    NOTHING_UM,
    SCENARIO,
    SECONDS,
    SEEDS,
    Alternative,
    Figures,
    FinishedRun,
    changed,
    compared,
    over_seeds,
)
from .sweeps import swept
from .tables import Table, finite_rows

PERFECT = "perfect knowledge"
PAPER = "the paper's scheme"
WHITE = "white noise of 0.05 mm"
CALIBRATED = "calibrated"
CONTACT_PLATES = ((REFERENCE, 2), (REFERENCE, 4), (FINGERTIP, 4), (FINGERTIP, 5), (WIDE, 8))  # and modes
OTHER_PREDICTORS = ("hold", "linear", "kalman_jerk")
PERCEIVED = ("still_friction_change", "slip_friction_change", "weber_frac")
FIGURES = ("leak_um", "slip_error_um", "slip_frac", "limited_frac", *PERCEIVED)
CONTACTS = ("felt_frac", "contact_leak_um", "contact_slip_um", "contrast", "contrast_median", *PERCEIVED)
PERCEIVED_NOTES = (
    "felt: share of time in which both fingers' friction is within the Weber fraction of what was asked",
    "friction_change: mean relative change of friction over the contact against the target's, still or slipping",
    f"weber: share of time in which it is beyond {WEBER_FRAC}, the least change that is felt",
)


def alternatives() -> dict[str, Alternative]:
    """hapticd, hapticd with a single choice changed, and the paper's scheme, by name."""
    ours = Settings(motion=REAL)
    found = {DEFAULT: Alternative(ours)}
    found |= {f"predictor {name}": Alternative(ours, PREDICTORS[name].for_touch) for name in OTHER_PREDICTORS}
    changes: dict[str, dict[str, dict[str, Any]]] = {
        "a single knot": {"solver": {"max_knots": 1}},
        "controller pi": {"device": {"controller": "pi"}},
    }
    found |= {name: Alternative(replace(ours, config=changed(ours.config, one))) for name, one in changes.items()}
    found[WHITE] = Alternative(replace(ours, noise=PadNoise(0.05)))
    found[PAPER] = Alternative(paper_settings(ours))
    return found


def run(*, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS, names: Sequence[str] | None = None) -> Table:
    """Compare the alternatives (all, or those in `names` and the default) on strokes of each seed."""
    chosen = {name: one for name, one in alternatives().items() if names is None or name in (*names, DEFAULT)}
    known: list[Figures] = []

    def judge(finished: FinishedRun) -> Figures:
        if finished.name == DEFAULT:
            known.append(_picked(perfect(finished.run).score, FIGURES))
        return _picked(finished.run.score, FIGURES)

    rows = [*compared(chosen, judge, seeds=seeds, seconds=seconds), (PERFECT, over_seeds(known))]
    return _table(
        "leak",
        f"{SCENARIO} of real hands, seeds {', '.join(map(str, seeds))}; one choice changed",
        rows,
        ("time_us", "leak_um", "slip_error_um"),
        "leak: RMS at the finger that should be still; slip: mean share that the other gets of its 1 um",
        *PERCEIVED_NOTES,
        "time: a pass from report to frame",
    )


def contact(*, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS) -> Table:
    """Compare plates and numbers of modes by what whole contacts feel."""
    plates = {
        f"{name} plate, {modes} modes": Settings(motion=REAL, plate=PlateSettings.of(name, modes))
        for name, modes in CONTACT_PLATES
    }
    calibrated = {
        f"{name}, {CALIBRATED}": Alternative(settings, measured=swept)
        for name, settings in plates.items()
        if not name.startswith(REFERENCE)
    }
    rows = [
        *_contact_rows(plates, SCENARIO, seeds, seconds),
        *compared(
            calibrated,
            lambda finished: _picked(finished.run.score, CONTACTS),
            seeds=seeds,
            seconds=seconds,
            scenario=SCENARIO,
            timed=False,
        ),
    ]
    return _table(
        "leak_contact",
        f"RMS over contacts of {CONTACT_RADIUS_MM:g} mm radius, {SCENARIO} of real hands",
        rows,
        CONTACTS,
        *PERCEIVED_NOTES,
        f"{CALIBRATED}: by `hapticd calibrate resonance`; the others' sensors see 1 % of each other's modes, unknown",
    )


def _contact_rows(
    chosen: Mapping[str, Settings], scenario: str, seeds: Sequence[int], seconds: float
) -> list[tuple[str, Figures]]:
    """Return the figures of each, then those of perfect knowledge of the same runs."""
    known: dict[str, list[Figures]] = {f"{name}, {PERFECT}": [] for name in chosen}

    def judge(finished: FinishedRun) -> Figures:
        known[f"{finished.name}, {PERFECT}"].append(_picked(perfect(finished.run).score, CONTACTS))
        return _picked(finished.run.score, CONTACTS)

    runs = {name: Alternative(settings) for name, settings in chosen.items()}
    rows = compared(runs, judge, seeds=seeds, seconds=seconds, scenario=scenario, timed=False)
    return [*rows, *((name, over_seeds(judged)) for name, judged in known.items())]


def _table(
    name: str, what: str, rows: Sequence[tuple[str, Mapping[str, float]]], compared_: tuple[str, ...], *notes: str
) -> Table:
    has_time = compared_[0] == "time_us"
    return Table(
        name=name,
        title=f"leak: {what}",
        default=rows[0][0],
        rows=finite_rows(rows),
        compared=compared_,
        time="time_us" if has_time else "",
        error=compared_[has_time],
        floor=NOTHING_UM,
        notes=notes,
    )


def _picked(score: Score, names: Sequence[str]) -> Figures:
    return {name: getattr(score, name) for name in names}
