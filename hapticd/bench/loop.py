"""The simulated loop in one world: what fingers get under each scheme, before and after a minute of touching."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..board_values import BoardCalibration, ModeCalibration
from ..daemon.recorder import header_of
from ..files.recording.kinds import record_of
from ..sim import lockstep
from ..sim.fingers.scenarios import SCENARIOS, STICKY_UM, Scenario, strokes
from ..sim.matched_person import matched_factor
from ..sim.perfect import perfect
from ..sim.plate.ground_truth import GroundTruth
from ..sim.score import Score
from ..sim.settings import Measured, Settings, in_world, knowing_person, paper_settings
from ..sim.world_errors import NEUTRAL
from ..sim.world_tolerances import draw
from ..tools import touch_correction as correction
from ..tools.touch_recording import COLLECTED, Collected, Touched, touched

HAPTICD, PAPER, PERFECT = "hapticd", "the paper's scheme", "perfect knowledge"
GUIDED = "hapticd after a guided minute"
NOTHING_WRONG = "nothing wrong"
SCENARIO = "strokes"
TELEMETRY_HZ = 500
ASKED = {  # whether targets are frictions, and whether the daemon has the person's curve
    "amplitudes": (False, False),
    "amplitudes, curve known": (False, True),
    "frictions": (True, False),
    "frictions, curve known": (True, True),
}
_OTHER_STROKES = 1000  # added to a seed: what is learned on some strokes is judged on others,
_SESSION = 1  # and in another session, with another posture


class Job(NamedTuple):
    """A world of a level, played for `seconds`, also after a guided touching of `touching_s`, unless that is 0. What
    fingers feel is judged where one is asked for `felt_um`, or the usual person's friction there, and the other for
    nothing; 0: not."""

    settings: Settings
    level: str
    seed: int
    seconds: float = 10.0
    touching_s: float = 0.0
    felt_um: float = 0.0


def play(job: Job) -> dict[str, Score]:
    """Return the score of each scheme, and of each of `ASKED` and a scheme, "asked: scheme"; those after
    touching are on other strokes than its touching."""
    world = NEUTRAL if job.level == NOTHING_WRONG else draw(job.level, job.seed)
    played = in_world(job.settings, world)

    def run(settings: Settings, known: Measured | None = None, scenario: Scenario | str = SCENARIO) -> lockstep.Run:
        return lockstep.run(scenario, settings=settings, seed=job.seed, seconds=job.seconds, measured=known)

    before = measured(played, job.seed)
    ours = run(played, before)
    scores = {HAPTICD: ours.score, PAPER: run(paper_settings(played)).score, PERFECT: perfect(ours).score}
    daemons = {HAPTICD: (played, before)}
    if job.touching_s:
        daemons[GUIDED] = _corrected(played, before, _touch(played, before, job))
        scores[GUIDED] = run(*daemons[GUIDED]).score
    if job.felt_um:
        asking = replace(SCENARIOS[SCENARIO], build=partial(strokes, targets_um=(job.felt_um, STICKY_UM)))
        knowing = {
            scheme: (knowing_person(settings, matched_factor(settings, known, job.seed, job.seconds)), known)
            for scheme, (settings, known) in daemons.items()
        }
        for asked, (friction_targets, knows_person) in ASKED.items():
            for scheme, (settings, known) in (knowing if knows_person else daemons).items():
                felt = run(replace(settings, friction_targets=friction_targets), known, asking)
                scores[f"{asked}: {scheme}"] = felt.score
            scores[f"{asked}: {PERFECT}"] = perfect(felt).score  # whatever the daemon knows
    return scores


def figures(scores: Sequence[Score]) -> dict[str, float]:
    """Return medians over worlds, the worst tenth, and how near the plate came to its limits in truth."""

    def of(share: float, figure: Callable[[Score], float]) -> float:
        return float(np.quantile([figure(score) for score in scores], share))

    return {
        "contrast": of(0.5, lambda score: score.contrast),
        "contrast_worst_tenth": of(0.1, lambda score: score.contrast),
        "contact_leak_um": of(0.5, lambda score: score.contact_leak_um),
        "limit_most_frac": of(1.0, lambda score: score.limit_frac),
    }


def felt_figures(scores: Sequence[Score]) -> dict[str, float]:
    """Return medians over worlds of what both fingers felt, the slippery one being the first."""
    rows = [
        {"felt_frac": score.felt_frac, "within_two_frac": score.within_two_frac}
        | {
            f"{name}_{figure}": getattr(finger, figure)
            for name, finger in zip(("slippery", "sticky"), score.fingers, strict=True)
            for figure in ("bias_jnd", "median_jnd", "error_95_jnd")
        }
        for score in scores
    ]
    return {name: float(np.median([row[name] for row in rows])) for name in rows[0]}


def measured(settings: Settings, seed: int) -> Measured:
    """Return what the scan and the sweep of a world gave, by which its daemon works."""
    plate = GroundTruth(settings.plate)
    rates = zip(
        *(plate.nominal_decay_1_s.tolist(), plate.nominal_detuning_rad_s.tolist()),
        *(plate.nominal_gain_um_per_v_s.tolist(), plate.drive.T.tolist(), plate.sense.tolist()),
        strict=True,
    )
    modes = []
    for mode, (decay_1_s, detuning_rad_s, gain_um_per_v_s, drive, sense) in enumerate(rates):
        hz = plate.settings.drive_hz + detuning_rad_s / (2.0 * math.pi)
        weights = tuple(map(complex, sense))
        modes.append(ModeCalibration(mode, hz, math.pi * hz / decay_1_s, gain_um_per_v_s, 0.0, tuple(drive), weights))
    return Measured(plate.measured_mode_map(seed), BoardCalibration(tuple(modes)))


def _touch(settings: Settings, before: Measured, job: Job) -> Touched:
    """Touch the plate in other strokes than those that are judged; return what the daemon would record."""
    config = replace(settings.config, record=replace(settings.config.record, telemetry_hz=TELEMETRY_HZ))
    actors = SCENARIOS["guided"].build(job.seed + _OTHER_STROKES, settings.speed_mm_s)
    simulation = lockstep.Simulation(actors, replace(settings, session=_SESSION, config=config), job.seed, before)
    machine, collected = simulation.machine, Collected()
    machine.parasitic_modes = simulation.world.plate.parasitic_modes(job.seed)
    header = header_of(machine, t_ns=lockstep.T_START_NS, utc="", is_whole=True)

    def put(kind: str, t_ns: int, *values: object) -> None:
        if kind in COLLECTED:
            collected.take(record_of(kind, 0, t_ns, values))

    machine.observer = put
    simulation.run(job.touching_s)
    return touched(collected, header, "touching")


def _corrected(settings: Settings, before: Measured, found: Touched) -> tuple[Settings, Measured]:
    """Return settings and measurements with what `hapticd calibrate touch` adopts."""
    judged = correction.judged_by(found)
    changes = correction.contact_settings(found, judged)
    modes, calibration = before
    if not judged.refusal:
        changes["trackpad"] = changes.get("trackpad", {}) | correction.pad_settings(found, judged.calibration)
        changes["uncertainty"] = correction.known_better(found, judged)
        if correction.has_sensors(found):
            calibration = correction.calibration_of(found, judged)
        if judged.waves is not None:
            modes = correction.mode_map(modes, judged)
    sections = {}
    for name, keys in changes.items():
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in keys.items()}
        sections[name] = replace(getattr(settings.config, name), **values)
    return replace(settings, config=replace(settings.config, **sections)), Measured(modes, calibration)
