"""Random laboratories: what fingers get where everything is a little wrong, and which cause costs how much.

Each laboratory is drawn with a seed of its own (`sim.world_tolerances`), and its fingers, noise and map have that seed
too. A laboratory is one job for a process, since its runs share maps.

    run       points on the paper's plate; contacts on the fingertip plate with its four modes
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from ..sim import lockstep
from ..sim.lockstep import Settings
from ..sim.perfect import perfect
from ..sim.plate.glasses import FINGERTIP
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import Score
from ..sim.world_errors import CAUSES, NEUTRAL, WorldErrors
from ..sim.world_tolerances import LEVELS, draw
from ..tools.progress import Progress
from ..tools.touch_correction import judged_by
from . import touching
from .tables import Table, finite_rows

WORLDS = 50
LABORATORY = "laboratory"
SCENARIO = "strokes"
SECONDS = 10.0
HAPTICD, AFTER, PAPER = "hapticd", "hapticd after a minute of touching", "the paper's scheme"
PERFECT, IDEAL = "perfect knowledge", "hapticd, nothing wrong"
CONTACT_CAUSES_EVERY = 5  # laboratories: runs with contacts take four times as long
_WORST_TENTH = 0.9

Scores = dict[str, Score]


def play(settings: Settings, world: WorldErrors, seed: int, seconds: float, touching_s: float) -> Scores:
    """Return the scores of each scheme in one world; that of AFTER is on other strokes than its touching."""
    run_as = partial(lockstep.run, SCENARIO, seed=seed, seconds=seconds)
    played = lockstep.in_world(settings, world)
    before = touching.measured(played, seed)
    ours = run_as(settings=played, measured=before)
    found = touching.touch(played, before, seed, touching_s)
    settled, after = touching.corrected(played, before, found, judged_by(found))
    return {
        HAPTICD: ours.score,
        AFTER: run_as(settings=settled, measured=after).score,
        PAPER: run_as(settings=lockstep.paper(ours.settings)).score,
        PERFECT: perfect(ours).score,
        IDEAL: run_as(settings=lockstep.in_world(settings, NEUTRAL)).score,
    }


def play_causes(settings: Settings, world: WorldErrors, seed: int, seconds: float) -> Scores:
    """Return the scores of hapticd with one cause of the world made perfect at a time."""
    return {
        cause: lockstep.run(
            SCENARIO, settings=lockstep.in_world(settings, world.without(cause)), seed=seed, seconds=seconds
        ).score
        for cause in CAUSES
    }


def run(
    *,
    worlds: int = WORLDS,
    seconds: float = SECONDS,
    touching_s: float = touching.TOUCHING_S,
    workers: int | None = None,
) -> tuple[Table, ...]:
    """Compare the schemes in `worlds` laboratories of each level, and the causes in those of the middle one."""
    points, contacts = Settings(), Settings(plate=PlateSettings.of(FINGERTIP))
    seeds = range(1, worlds + 1)
    job = partial(Job, seconds=seconds, touching_s=touching_s)
    jobs = {(name, seed): job(points, name, seed, has_causes=name == LABORATORY) for name in LEVELS for seed in seeds}
    jobs |= {
        (FINGERTIP, seed): job(contacts, LABORATORY, seed, has_causes=seed % CONTACT_CAUSES_EVERY == 1)
        for seed in seeds
    }
    done = played(jobs, os.cpu_count() or 1 if workers is None else workers)
    by_level = {level: [done[level, seed] for seed in seeds] for level in LEVELS}
    at_contacts = [done[FINGERTIP, seed] for seed in seeds]
    return (
        _levels(by_level),
        _causes("worlds_causes", "points", by_level[LABORATORY], lambda score: score.leak_um),
        _contacts(at_contacts),
        _causes(
            "worlds_contact_causes",
            "contacts on the fingertip plate",
            [scores for scores in at_contacts if CAUSES[0] in scores],
            lambda score: score.contact_leak_um,
        ),
    )


class Job(NamedTuple):
    """One laboratory: of a level, touched for `touching_s`, played for `seconds`, with each cause or without."""

    settings: Settings
    level: str
    seed: int
    seconds: float
    touching_s: float
    has_causes: bool


def _laboratory(job: Job) -> Scores:
    world = draw(job.level, job.seed)
    scores = play(job.settings, world, job.seed, job.seconds, job.touching_s)
    return scores | (play_causes(job.settings, world, job.seed, job.seconds) if job.has_causes else {})


def played(jobs: Mapping[tuple[str, int], Job], workers: int) -> dict[tuple[str, int], Scores]:
    """Return each job's scores, from this process or from `workers` others."""
    done: dict[tuple[str, int], Scores] = {}
    with Progress("worlds") as progress:
        if workers == 1:
            for key, job in jobs.items():
                done[key] = _laboratory(job)
                progress(len(done) / len(jobs))
            return done
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            waiting = {pool.submit(_laboratory, job): key for key, job in jobs.items()}
            for finished in as_completed(waiting):
                done[waiting[finished]] = finished.result()
                progress(len(done) / len(jobs))
    return done


def _levels(by_level: Mapping[str, Sequence[Scores]]) -> Table:
    rows = []
    for level, laboratories in by_level.items():
        for scheme in (HAPTICD, AFTER, PAPER, PERFECT, IDEAL):
            of = [scores[scheme] for scores in laboratories]
            figures = _spread([score.leak_um for score in of], "leak")
            figures["slip_frac"] = _quantile([score.slip_frac for score in of], 0.5)
            figures["paper_ratio"] = _quantile(_ratios(laboratories, PAPER, scheme), 0.5)
            figures["before_ratio_most"] = max(_ratios(laboratories, scheme, HAPTICD), default=float("nan"))
            rows.append((f"{level}: {scheme}", figures))
    return Table(
        name="worlds",
        title=f"worlds: {SCENARIO} in {len(by_level[LABORATORY])} random laboratories of each kind, at points",
        default=f"{LABORATORY}: {HAPTICD}",
        rows=finite_rows(rows),
        compared=("leak_um", "leak_worst_tenth_um"),
        notes=(
            "leak: median over the laboratories; worst tenth: a tenth of them leaks more",
            "paper ratio: how many times more the paper's scheme leaks in the same laboratory, median; before ratio: "
            "leak over that of hapticd before touching, the most of all laboratories",
        ),
    )


def _ratios(laboratories: Sequence[Scores], over: str, under: str) -> list[float]:
    """Return the leak of one scheme over that of another in each laboratory."""
    return [scores[over].leak_um / scores[under].leak_um for scores in laboratories]


def _contacts(laboratories: Sequence[Scores]) -> Table:
    rows = []
    for scheme in (HAPTICD, AFTER, PAPER, PERFECT, IDEAL):
        of = [scores[scheme] for scores in laboratories]
        contrasts = [score.contrast for score in of]
        figures = _spread([score.contact_leak_um for score in of], "contact_leak")
        figures |= {
            "contrast": _quantile(contrasts, 0.5),
            "contrast_worst_tenth": _quantile(contrasts, 1.0 - _WORST_TENTH),
        }
        rows.append((scheme, figures))
    return Table(
        name="worlds_contact",
        title=f"worlds: {SCENARIO} in {len(laboratories)} random laboratories, over contacts on the fingertip plate",
        default=HAPTICD,
        rows=finite_rows(rows),
        compared=("contact_leak_um", "contrast"),
        notes=("contrast: median over the laboratories; worst tenth: a tenth of them has less",),
    )


def _causes(name: str, where: str, laboratories: Sequence[Scores], leak_um: Callable[[Score], float]) -> Table:
    """Return the leak with each cause made perfect, largest share first."""
    all_um = [leak_um(scores[HAPTICD]) for scores in laboratories]
    rows = []
    for cause in CAUSES if laboratories else ():
        known_um = [leak_um(scores[cause]) for scores in laboratories]
        share = 1.0 - np.mean(np.square(known_um)) / np.mean(np.square(all_um))
        rows.append((f"{cause} perfect", _spread(known_um, "leak") | {"share_frac": float(share)}))
    rows.sort(key=lambda row: -row[1]["share_frac"])
    return Table(
        name=name,
        title=f"worlds: one cause made perfect, {len(laboratories)} laboratories, {where}",
        default=HAPTICD,
        rows=finite_rows([(HAPTICD, _spread(all_um, "leak")), *rows]),
        compared=("leak_um",),
        notes=("share: by how much the mean square of the leak falls",),
    )


def _spread(values_um: Sequence[float], what: str) -> dict[str, float]:
    return {f"{what}_um": _quantile(values_um, 0.5), f"{what}_worst_tenth_um": _quantile(values_um, _WORST_TENTH)}


def _quantile(values: Sequence[float], share: float) -> float:
    return float(np.quantile(values, share)) if values else float("nan")
