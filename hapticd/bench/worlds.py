"""Random laboratories: what contacts get where everything is a little wrong.

Each laboratory is drawn with a seed of its own (`sim.world_tolerances`), and its fingers, noise and map have that seed
too. A laboratory is one task of a campaign, since its runs share maps. Leak and contrast are those of the fingertip
plate with its four modes in all kinds of world. What is felt there, and on the wide plate with both pads, is judged for
amplitudes and for frictions, with and without this person's curve: at 0.5 um, or the usual person's friction there, on
four modes, at 1 um on eight.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from ..design.campaign import TaskRunner, one_by_one
from ..sim.fingers.scenarios import HALF_UM, REAL, SLIPPERY_UM
from ..sim.plate.glasses import FINGERTIP, WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import Score
from ..sim.settings import Settings
from ..sim.world_tolerances import LEVELS
from ..tools.latency_felt import PadAndLine, settings_of
from . import loop
from .loop import ASKED, GUIDED, HAPTICD, NOTHING_WRONG, PAPER, PERFECT, SCENARIO, Job
from .tables import Table

MILD, LABORATORY, WORST = LEVELS
PANEL = "wide, panel of 240 Hz"
PLATES = {
    FINGERTIP: (Settings(motion=REAL, plate=PlateSettings.of(FINGERTIP)), HALF_UM),
    WIDE: (Settings(motion=REAL, plate=PlateSettings.of(WIDE)), SLIPPERY_UM),
    PANEL: (settings_of(PadAndLine(240.0, 5.0, 1.5), PlateSettings.of(WIDE)), SLIPPERY_UM),
}
WORSE_FRAC = 0.05  # of time: a smaller loss of what is felt does not count
FEW = 5  # laboratories to one of every other kind of world
_Scores = Sequence[dict[str, Score]]


def run(
    worlds: int,
    *,
    seconds: float = 10.0,
    touching_s: float = 60.0,
    campaign: TaskRunner = one_by_one,
) -> tuple[Table, ...]:
    """Compare the schemes in `worlds` laboratories."""
    few = range(1, worlds + 1, FEW)
    levels = {LABORATORY: range(1, worlds + 1)} | dict.fromkeys((NOTHING_WRONG, MILD, WORST), few)
    jobs: dict[tuple[str, str, int], Job] = {}
    for glass, (settings, felt_um) in PLATES.items():
        for level, seeds in levels.items() if glass == FINGERTIP else [(LABORATORY, levels[LABORATORY])]:
            for seed in seeds:
                asked_um = felt_um if level == LABORATORY else 0.0
                jobs[glass, level, seed] = Job(settings, level, seed, seconds, touching_s, asked_um)
    played = dict(zip(jobs, campaign("worlds", loop.play, [*jobs.values()]), strict=True))

    def of(glass: str, level: str) -> _Scores:
        return [scores for key, scores in played.items() if key[:2] == (glass, level)]

    return (
        _levels({level: of(FINGERTIP, level) for level in levels}),
        _felt({glass: of(glass, LABORATORY) for glass in PLATES}),
    )


def _levels(by_level: dict[str, _Scores]) -> Table:
    rows = {}
    for level, worlds in by_level.items():
        for scheme in (HAPTICD, GUIDED, PAPER, PERFECT):
            over_before = [scores[scheme].contact_leak_um / scores[HAPTICD].contact_leak_um for scores in worlds]
            most = {"most_over_before_ratio": max(over_before)}
            rows[f"{level}: {scheme}"] = loop.figures([scores[scheme] for scores in worlds]) | most
    counts = ", ".join(f"{len(worlds)} x {level}" for level, worlds in by_level.items())
    notes = (
        "medians over the worlds; worst tenth: a tenth of them is worse",
        "over before: leak over that of hapticd before touching, the most of all worlds",
        "limit: the plate's true amplitude in a mode over its W_LIM, the most of all worlds",
    )
    return Table("worlds", f"worlds: {SCENARIO}, contacts: {counts}", rows, notes)


def _felt(laboratories: dict[str, _Scores]) -> Table:
    rows = {}
    for glass, worlds in laboratories.items():
        for asked in ASKED:
            first = [scores[f"{asked.partition(',')[0]}: {HAPTICD}"] for scores in worlds]
            for scheme in (HAPTICD, GUIDED, PERFECT):
                scored = [scores[f"{asked}: {scheme}"] for scores in worlds]
                lost = [before.felt_frac - score.felt_frac for before, score in zip(first, scored, strict=True)]
                worse = {"worse_frac": fmean(frac > WORSE_FRAC for frac in lost)}
                rows[f"{glass}, {asked}: {scheme}"] = loop.felt_figures(scored) | worse
    notes = (
        "medians over the laboratories; felt, within two: both fingers within one or two JND (0.11) of what was asked",
        f"worse: share of laboratories that feel over {WORSE_FRAC:.0%} less than before touching, by the usual curve",
        "amplitudes: judged by what they give this person, even over the contact; frictions: by themselves",
        "curve known: the person's scale, as simulated observers match it on this plate, for all fingers",
    )
    each = ", ".join(f"{len(worlds)} x {glass}" for glass, worlds in laboratories.items())
    return Table("worlds_felt", f"worlds: {SCENARIO}, what is felt in laboratories, {each}", rows, notes)
