"""Friction as asked where contacts are of another size or form: believed to be discs, or as the pad reports them.

Where discs are believed, nothing in the simulation moves by the form of a contact, so one run is scored for contacts of
every form; where the pad's ellipses are used, each form is a run of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..sim.fingers.fingertip import Fingertip
from ..sim.fingers.pad_ellipse import calibrated
from ..sim.fingers.scenarios import REAL
from ..sim.lockstep import Run
from ..sim.perfect import perfect
from ..sim.plate.glasses import FINGERTIP, WIDE
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM, with_contacts
from ..sim.settings import Settings
from .leak_runs import SCENARIO, SECONDS, SEEDS, Alternative, Figures, compared
from .tables import Table, finite_rows

PLATES = ((FINGERTIP, 4), (FINGERTIP, 6), (WIDE, 8))  # and modes
RADII_MM = (CONTACT_RADIUS_MM, 4.0, 6.0, 7.0)  # of discs
AXES_MM = (11.0, 8.0)  # of ellipses, whole
TURNS_RAD = (0.0, np.pi / 3.0, 2.0 * np.pi / 3.0)
FORMS: dict[str, tuple[Fingertip, ...]] = {f"discs of {mm:g} mm radius": (Fingertip(mm, mm),) for mm in RADII_MM}
FORMS[f"ellipses with diameters of {AXES_MM[1]:g} x {AXES_MM[0]:g} mm"] = tuple(
    Fingertip(AXES_MM[0] / 2.0, AXES_MM[1] / 2.0, turn_rad) for turn_rad in TURNS_RAD
)
FORMS["discs of 5 mm radius that swell by 20 % at 1 Hz"] = (Fingertip(swell_frac=0.2, swell_hz=1.0),)


class _Case(NamedTuple):
    form: str
    tip: Fingertip


def run(*, plates: Sequence[tuple[str, int]] = PLATES, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS) -> Table:
    """Compare forms of contacts on some plates."""
    rows: list[tuple[str, Figures]] = []
    for glass, modes in plates:
        found = _by_form(Settings(motion=REAL, plate=PlateSettings.of(glass, modes)), seeds, seconds)
        rows += [(f"{glass} plate, {modes} modes, {form}", figures) for form, figures in found.items()]
    return Table(
        name="contact_forms",
        title=f"leak: friction as asked over contacts of other forms, {SCENARIO} of real hands",
        default=rows[0][0],
        rows=finite_rows(rows),
        compared=("felt_frac",),
        notes=(
            "felt: contacts as the pad reports their ellipses, with its noise (`trackpad.ellipse_scale`)",
            f"disc: discs of {CONTACT_RADIUS_MM:g} mm radius are believed; perfect: contacts known",
        ),
    )


def _by_form(settings: Settings, seeds: Sequence[int], seconds: float) -> dict[str, Figures]:
    believed = compared(
        {"": Alternative(settings)}, lambda one: _scored(one.run), seeds=seeds, seconds=seconds, timed=False
    )[0][1]
    cases = {f"{form} {turn}": _Case(form, tip) for form, tips in FORMS.items() for turn, tip in enumerate(tips)}
    config = calibrated(settings.config)
    reported = compared(
        {name: Alternative(replace(settings, fingertip=case.tip, config=config)) for name, case in cases.items()},
        lambda one: {"felt_frac": one.run.score.felt_frac, "perfect_frac": perfect(one.run).score.felt_frac},
        seeds=seeds,
        seconds=seconds,
        timed=False,
    )
    found: dict[str, Figures] = {}
    for form in FORMS:
        of_form = [figures for name, figures in reported if cases[name].form == form]
        means = {name: float(np.mean([one[name] for one in of_form])) for name in ("felt_frac", "perfect_frac")}
        found[form] = {**means, "disc_frac": believed[form]}
    return found


def _scored(run: Run) -> Figures:
    """Return how contacts of every form feel a run in which nothing depends on their form."""
    scored = (
        run.score,
        run.t_s,
        run.finger_true_mm,
        run.target_um,
        run.plate_um,
        GroundTruth(run.settings.plate).shapes,
    )
    fingers = len(run.fingertips)
    return {
        form: float(np.mean([with_contacts(*scored, fingertips=[tip] * fingers).felt_frac for tip in tips]))
        for form, tips in FORMS.items()
    }
