"""Random laboratories: what fingers get where everything is a little wrong, and which cause costs how much.

Each laboratory is drawn with a seed of its own (`sim.world_tolerances`), and its fingers, noise and map have that seed
too. A laboratory is one task of a campaign, since its runs share maps. At points on the paper's plate in all kinds of
world; over contacts on the fingertip plate with its four modes. Some laboratories are played with each cause perfect.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

import numpy as np

from ..design.campaign import TaskRunner, one_by_one
from ..sim.fingers.scenarios import REAL
from ..sim.plate.glasses import FINGERTIP, REFERENCE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import Score
from ..sim.settings import Settings
from ..sim.world_errors import CAUSES
from ..sim.world_tolerances import LEVELS
from .loop import AFTER, GUIDED, HAPTICD, NOTHING_WRONG, PAPER, PERFECT, SCENARIO, Job, figures, play
from .tables import Table

LABORATORY, WORST = "laboratory", LEVELS[-1]
FEW = 5  # one laboratory in so many is played with each cause made perfect, and one world with nothing wrong
_Scores = Sequence[dict[str, Score]]


def run(
    worlds: int,
    *,
    seconds: float = 10.0,
    touching_s: float = 60.0,
    causes: tuple[str, ...] = CAUSES,
    campaign: TaskRunner = one_by_one,
) -> tuple[Table, ...]:
    """Compare the schemes in `worlds` laboratories of each level, and `causes` in some of the middle one."""
    all_seeds, few_seeds = range(1, worlds + 1), range(1, worlds + 1, FEW)
    points = dict.fromkeys((LABORATORY, *LEVELS), all_seeds) | {NOTHING_WRONG: few_seeds}
    contacts = {LABORATORY: all_seeds, NOTHING_WRONG: few_seeds, WORST: few_seeds}
    jobs: dict[tuple[str, str, int], Job] = {}
    for glass, levels, touched in ((REFERENCE, points, (AFTER,)), (FINGERTIP, contacts, (AFTER, GUIDED))):
        settings = Settings(motion=REAL, plate=PlateSettings.of(glass))
        for level, seeds in levels.items():
            for seed in seeds:
                perfected = causes if level == LABORATORY and seed in few_seeds else ()
                jobs[glass, level, seed] = Job(settings, level, seed, seconds, touching_s, perfected, touched)
    played = dict(zip(jobs, campaign("worlds", play, [*jobs.values()]), strict=True))

    def of(glass: str, levels: Sequence[str]) -> dict[str, _Scores]:
        return {level: [scores for key, scores in played.items() if key[:2] == (glass, level)] for level in levels}

    at_points, over_contacts = of(REFERENCE, [*points]), of(FINGERTIP, [*contacts])
    return (
        _levels("worlds", "at points", at_points, (HAPTICD, AFTER, PAPER, PERFECT), "leak_um"),
        _causes("worlds_causes", "at points", at_points[LABORATORY], "leak_um"),
        _levels(
            "worlds_contact", "contacts", over_contacts, (HAPTICD, AFTER, GUIDED, PAPER, PERFECT), "contact_leak_um"
        ),
        _causes("worlds_contact_causes", "contacts", over_contacts[LABORATORY], "contact_leak_um"),
    )


def _levels(name: str, where: str, by_level: dict[str, _Scores], schemes: Sequence[str], leak: str) -> Table:
    rows, leak_um = {}, attrgetter(leak)
    for level, worlds in by_level.items():
        for scheme in schemes:
            over_before = [leak_um(scores[scheme]) / leak_um(scores[HAPTICD]) for scores in worlds]
            most = {"most_over_before_ratio": max(over_before)}
            rows[f"{level}: {scheme}"] = figures([scores[scheme] for scores in worlds]) | most
    counts = ", ".join(f"{len(worlds)} x {level}" for level, worlds in by_level.items())
    notes = (
        "medians over the worlds; worst tenth: a tenth of them is worse",
        "over before: leak over that of hapticd before touching, the most of all worlds",
        "limit: the plate's true amplitude in a mode over its W_LIM, the most of all worlds",
    )
    return Table(name, f"worlds: {SCENARIO}, {where}: {counts}", rows, (leak, "contrast"), notes)


def _causes(name: str, where: str, laboratories: _Scores, leak: str) -> Table:
    """Return the leak before touching with each cause made perfect, largest share first."""
    few = [scores for scores in laboratories if {*scores} & {*CAUSES}]
    all_um = np.array([getattr(scores[HAPTICD], leak) for scores in few])
    rows = {HAPTICD: {"leak_um": float(np.median(all_um))}}
    for cause in (cause for cause in CAUSES if few and cause in few[0]):
        known_um = np.array([getattr(scores[cause], leak) for scores in few])
        share = 1.0 - np.mean(known_um**2) / np.mean(all_um**2)
        rows[f"{cause} perfect"] = {"leak_um": float(np.median(known_um)), "share_frac": float(share)}
    ordered = dict(sorted(rows.items(), key=lambda row: -row[1].get("share_frac", np.inf)))
    title = f"worlds: one cause made perfect, {len(few)} laboratories, {where}"
    return Table(name, title, ordered, ("leak_um",), ("share: that of the mean square of the leak",))
