"""Random laboratories: what fingers get where everything is a little wrong, and which cause costs how much.

Each laboratory is drawn with a seed of its own (`sim.world_tolerances`), and its fingers, noise and map have that seed
too. A laboratory is one job for a process, since its runs share maps.

    run       points on the paper's plate in all kinds of world; contacts on the fingertip plate with its four modes in
              laboratories, with nothing wrong and with the worst; one laboratory in FEW also with one cause made
              perfect at a time
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ..design.campaign import TaskRunner, one_by_one
from ..sim import lockstep
from ..sim.fingers.scenarios import REAL
from ..sim.lockstep import Run
from ..sim.perfect import perfect
from ..sim.plate.glasses import FINGERTIP, REFERENCE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import Score
from ..sim.settings import Settings, in_world, paper_settings
from ..sim.world_errors import CAUSES, NEUTRAL
from ..sim.world_tolerances import LEVELS, draw
from ..tools.touch_correction import judged_by
from . import telemetry, touching
from .tables import Table, finite_rows

WORLDS = 50
LABORATORY = "laboratory"
SCENARIO = "strokes"
SECONDS = 10.0
HAPTICD, AFTER = "hapticd", "hapticd after a minute of touching"
GUIDED, PAPER = "hapticd after a guided minute", "the paper's scheme"
PERFECT, NOTHING_WRONG = "perfect knowledge", "nothing wrong"
TOUCHED = {AFTER: touching.FREE, GUIDED: touching.GUIDED}  # the scenario that each learns from
FEW = 5  # of so many laboratories one is played with each cause made perfect, and one with nothing wrong
_WORST_TENTH = 0.9
_SAID_NOTE = (
    "said: amplitude over contacts as telemetry says it over the true one, that of the still finger, and in which "
    "share of a world's states the true one is within the interval; medians"
)
_PEAK_NOTE = "limit: the plate's true amplitude in a mode over its W_LIM, the most of all worlds"
WORST = LEVELS[-1]
_Key = tuple[str, str, int]  # plate, level and seed


class WorldScore(NamedTuple):
    """The score of a scheme in one world; of amplitudes over contacts the median ratio of what telemetry said to what
    is true, that of the still finger, and in which share the interval held: NaN where nothing subscribed."""

    score: Score
    said_ratio: float = math.nan
    said_still_ratio: float = math.nan
    said_within_frac: float = math.nan


Scores = dict[str, WorldScore]


def play(job: Job) -> Scores:
    """Return the scores of each scheme in one world; those after touching are on other strokes than its touching."""
    world = NEUTRAL if job.level == NOTHING_WRONG else draw(job.level, job.seed)
    run_as = partial(lockstep.run, SCENARIO, seed=job.seed, seconds=job.seconds)
    played = in_world(job.settings, world)
    before = touching.measured(played, job.seed)
    ours, said = telemetry.reported(SCENARIO, played, job.seed, job.seconds, before)
    scores = {HAPTICD: _with_said(ours, said)}
    for scheme in job.touched:
        found = touching.touch(played, before, job.seed, job.touching_s, TOUCHED[scheme])
        settled, after = touching.corrected(played, before, found, judged_by(found))
        scores[scheme] = _with_said(*telemetry.reported(SCENARIO, settled, job.seed, job.seconds, after))
    scores[PAPER] = WorldScore(run_as(settings=paper_settings(ours.settings)).score)
    scores[PERFECT] = WorldScore(perfect(ours).score)
    for cause in job.causes:
        without = in_world(job.settings, world.without(cause))
        scores[cause] = WorldScore(run_as(settings=without, measured=touching.measured(without, job.seed)).score)
    return scores


def _with_said(played: Run, said: telemetry.FeltReport) -> WorldScore:
    of_all, of_still = (telemetry.figures(said.of(chosen)) for chosen in (said.target_um >= 0.0, said.target_um == 0.0))
    return WorldScore(played.score, of_all["ratio"], of_still["ratio"], of_all["within_frac"])


def run(
    *,
    worlds: int = WORLDS,
    seconds: float = SECONDS,
    touching_s: float = touching.TOUCHING_S,
    causes: tuple[str, ...] = CAUSES,
    campaign: TaskRunner = one_by_one,
) -> tuple[Table, ...]:
    """Compare the schemes in `worlds` laboratories of each level, and `causes` in those of the middle one."""
    points, contacts = (Settings(motion=REAL, plate=PlateSettings.of(glass)) for glass in (REFERENCE, FINGERTIP))
    seeds, few = range(1, worlds + 1), range(1, worlds + 1, FEW)

    def job(settings: Settings, level: str, seed: int) -> Job:
        is_few = level == LABORATORY and seed in few
        touched = (AFTER, GUIDED) if settings is contacts else (AFTER,)
        return Job(settings, level, seed, seconds, touching_s, causes if is_few else (), touched)

    played = [(points, level, seeds) for level in LEVELS] + [(points, NOTHING_WRONG, few)]
    played += [(contacts, LABORATORY, seeds), (contacts, NOTHING_WRONG, few), (contacts, WORST, few)]
    jobs = {
        (settings.plate.plate, level, seed): job(settings, level, seed) for settings, level, of in played for seed in of
    }
    scores = campaign("worlds", play, [*jobs.values()])
    return tables(dict(zip(jobs, scores, strict=True)))


def tables(done: Mapping[_Key, Scores]) -> tuple[Table, ...]:
    """Return the tables of what was played."""
    found: dict[str, dict[str, list[Scores]]] = {}
    for (plate, level, _), scores in done.items():
        found.setdefault(plate, {}).setdefault(level, []).append(scores)
    points, contacts = found[REFERENCE], found[FINGERTIP]
    where = "contacts on the fingertip plate"
    return (
        _levels(points),
        _causes("worlds", "points", points[LABORATORY], lambda score: score.leak_um),
        _contacts(contacts),
        _causes("worlds_contact", where, contacts[LABORATORY], lambda score: score.contact_leak_um),
    )


class Job(NamedTuple):
    """One laboratory: of a level, played for `seconds`, also after having been touched for `touching_s` as each scheme
    of `touched` does it, and with each of `causes` perfect."""

    settings: Settings
    level: str
    seed: int
    seconds: float
    touching_s: float
    causes: tuple[str, ...]
    touched: tuple[str, ...] = (AFTER,)


def _levels(by_level: Mapping[str, Sequence[Scores]]) -> Table:
    rows = []
    for level, laboratories in by_level.items():
        for scheme in (HAPTICD, AFTER, PAPER, PERFECT):
            of = [scores[scheme].score for scores in laboratories]
            figures = _spread([score.leak_um for score in of], "leak")
            figures["slip_frac"] = _quantile([score.slip_frac for score in of], 0.5)
            if scheme != PERFECT:  # which leaks nothing at points
                ratios = _ratios(laboratories, PAPER, scheme)
                figures["paper_ratio"] = _quantile(ratios, 0.5)
                figures["paper_ratio_least"] = min(ratios, default=float("nan"))
            figures["before_ratio_most"] = max(_ratios(laboratories, scheme, HAPTICD), default=float("nan"))
            rows.append((f"{level}: {scheme}", figures | _said(laboratories, scheme) | _peak(of)))
    return Table(
        name="worlds",
        title=f"worlds: {SCENARIO} in {len(by_level[LABORATORY])} laboratories of each kind, at points",
        default=f"{LABORATORY}: {HAPTICD}",
        rows=finite_rows(rows),
        compared=("leak_um", "leak_worst_tenth_um"),
        notes=(
            "leak: median over the laboratories; worst tenth: a tenth of them leaks more",
            "paper ratio: how many times more the paper's scheme leaks in the same laboratory, median; before ratio: "
            "leak over that of hapticd before touching, the most of all laboratories",
            f"{NOTHING_WRONG}: in {len(by_level[NOTHING_WRONG])} worlds as the daemon is configured for",
            _SAID_NOTE,
            _PEAK_NOTE,
        ),
    )


def _ratios(laboratories: Sequence[Scores], over: str, under: str) -> list[float]:
    """Return the leak of one scheme over that of another in each laboratory."""
    return [scores[over].score.leak_um / scores[under].score.leak_um for scores in laboratories]


def _contacts(by_level: Mapping[str, Sequence[Scores]]) -> Table:
    rows = []
    for level, laboratories in by_level.items():
        for scheme in (HAPTICD, *TOUCHED, PAPER, PERFECT):
            of = [scores[scheme].score for scores in laboratories]
            contrasts = [score.contrast for score in of]
            figures = {"felt_frac": _quantile([score.felt_frac for score in of], 0.5)}
            figures |= {"contact_slip_um": _quantile([score.contact_slip_um for score in of], 0.5)}
            figures |= _spread([score.contact_leak_um for score in of], "contact_leak")
            figures["contrast"] = _quantile(contrasts, 0.5)
            figures["contrast_worst_tenth"] = _quantile(contrasts, 1.0 - _WORST_TENTH)
            before = [scores[HAPTICD].score.contrast / scores[scheme].score.contrast for scores in laboratories]
            figures["before_ratio_most"] = max(before, default=float("nan"))
            rows.append((f"{level}: {scheme}", figures | _said(laboratories, scheme) | _peak(of)))
    counts = ", ".join(f"{len(laboratories)} x {level}" for level, laboratories in by_level.items())
    return Table(
        name="worlds_contact",
        title=f"worlds: {SCENARIO} over contacts on the fingertip plate: {counts}",
        default=f"{LABORATORY}: {HAPTICD}",
        rows=finite_rows(rows),
        compared=("contact_leak_um", "contrast"),
        notes=(
            "medians over the worlds; worst tenth: a tenth of them has less contrast; before ratio: contrast of "
            "hapticd before touching over that of the row, the most of all worlds",
            _SAID_NOTE,
            _PEAK_NOTE,
        ),
    )


def _said(laboratories: Sequence[Scores], scheme: str) -> dict[str, float]:
    """Return the medians of how well telemetry says what is felt; NaN where nothing subscribed."""
    names = WorldScore._fields[1:]
    return {name: _quantile([getattr(scores[scheme], name) for scores in laboratories], 0.5) for name in names}


def _peak(of: Sequence[Score]) -> dict[str, float]:
    """Return the largest true amplitude of a mode over its limit; perfect knowledge needs none."""
    most = max(score.limit_frac for score in of)
    return {"limit_frac_most": most} if np.isfinite(most) else {}


def _causes(name: str, where: str, laboratories: Sequence[Scores], leak_um: Callable[[Score], float]) -> Table:
    """Return the leak before touching with each cause made perfect, largest share first."""
    few = [scores for scores in laboratories if any(cause in scores for cause in CAUSES)]
    all_um = [leak_um(scores[HAPTICD].score) for scores in few]
    rows = []
    for cause in (cause for cause in CAUSES if few and cause in few[0]):
        known_um = [leak_um(scores[cause].score) for scores in few]
        share = 1.0 - np.mean(np.square(known_um)) / np.mean(np.square(all_um))
        rows.append((f"{cause} perfect", _spread(known_um, "leak") | {"share_frac": float(share)}))
    rows.sort(key=lambda row: -row[1]["share_frac"])
    return Table(
        name=f"{name}_causes",
        title=f"worlds: one cause made perfect, {len(few)} laboratories, {where}",
        default=HAPTICD,
        rows=finite_rows([(HAPTICD, _spread(all_um, "leak")), *rows]),
        compared=("leak_um",),
        notes=("share: by how much the mean square of the leak falls",),
    )


def _spread(values_um: Sequence[float], what: str) -> dict[str, float]:
    return {f"{what}_um": _quantile(values_um, 0.5), f"{what}_worst_tenth_um": _quantile(values_um, _WORST_TENTH)}


def _quantile(values: Sequence[float], share: float) -> float:
    return float(np.quantile(values, share)) if values else float("nan")
