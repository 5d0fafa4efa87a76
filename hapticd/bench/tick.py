"""One pass of a touch, from a report's bytes to the frame's: by stage, and what is spared when a scene needs less.

Hot: one pass after the other, the least of several repeats. Paced: at the pad's 88.9 Hz with sleep between them, as the
daemon runs, when caches and branch predictors have forgotten the path.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..compiled import why_interpreted
from ..config.sections import Config
from ..daemon.machine import Machine
from ..sim.fingers.scenarios import LAND_S, SCENARIOS, SPEED_MM_S
from ..sim.lockstep import Settings
from ..values import AmplitudeTarget, GratingTarget
from .recording import Publish, Recording, WaitUntil, new_machine, play, record, sleep_until
from .stopwatch import STAGES, Stopwatch
from .tables import Table, finite_rows
from .timing import REPEATS, least_by_pass, no_garbage_collection

PERIOD_S = 0.01125
DEFAULT = "two fingers"
WHOLE = "whole pass"
REST = "everything else"
_SETTLE_S = 0.5  # from landing to the first pass that counts
_SKIPPED = ("skipped_no_finger", "skipped_no_target", "skipped_standing")
_STAGE_NOTE = "track: with the sensor's clock; session: number and clocks; everything else: the pipeline and supervisor"


def run(
    *, seconds: float = 2.0, repeats: int = REPEATS, passes: int = 300, wait_until: WaitUntil = sleep_until
) -> tuple[Table, Table]:
    """Time passes: `passes` of them hot, and those of `seconds` paced. Where they run as machine code they are timed
    as Python too, in a process of its own: only there can the stages be told apart."""
    here = _measured(seconds, repeats, passes, wait_until)
    if why_interpreted() != "":
        return _stage_table(here), _situation_table(here.situations)
    as_python = _measured_as_python(seconds, repeats, passes)
    situations = {
        name: {
            "hot_us": figures["hot_us"],
            "hot_p50_us": figures["hot_p50_us"],
            "interpreted_us": as_python.situations[name]["hot_us"],
            **figures,
        }
        for name, figures in here.situations.items()
    }
    return _stage_table(as_python), _situation_table(situations)


class _Measured(NamedTuple):
    """Figures by situation, and by stage of the default one: none where the passes run as machine code."""

    situations: dict[str, dict[str, float]]
    stages: dict[str, dict[str, float]]


def _measured(seconds: float, repeats: int, passes: int, wait_until: WaitUntil = sleep_until) -> _Measured:
    situations = _situations(LAND_S + _SETTLE_S + max(seconds, passes * PERIOD_S))
    hot_us: dict[str, list[list[float]]] = {name: [] for name in situations}
    watched: list[dict[str, list[float]]] = []
    can_be_watched = why_interpreted() != ""
    with no_garbage_collection():
        stopwatch = Stopwatch()
        for _ in range(repeats):
            for name, situation in situations.items():
                hot_us[name].append(play(situation.recording, situation.machine(), limit=passes))
            if can_be_watched:
                watched.append(_watched(situations[DEFAULT], stopwatch, passes))
    figures = {}
    for name, situation in situations.items():
        hot = least_by_pass(hot_us[name]).figures("hot")
        hot["hot_p50_us"] = statistics.median(map(min, zip(*hot_us[name], strict=True)))
        figures[name] = {**hot, **_paced(situation, seconds, wait_until), **_skipped(situation)}
    if not can_be_watched:
        return _Measured(figures, {})
    paced = _paced_stages(situations[DEFAULT], seconds, wait_until)
    return _Measured(
        figures,
        {stage: {**least_by_pass([one[stage] for one in watched]).figures("hot"), **paced[stage]} for stage in STAGES},
    )


def _measured_as_python(seconds: float, repeats: int, passes: int) -> _Measured:
    done = subprocess.run(
        [sys.executable, "-m", __name__, str(seconds), str(repeats), str(passes)],
        env={**os.environ, "HAPTICD_PURE": "1"},
        stdout=subprocess.PIPE,
        check=True,
    )
    return _Measured(*json.loads(done.stdout))


@dataclass(frozen=True, slots=True)
class _Situation:
    """What is on the plate, and the service that serves it."""

    recording: Recording
    config: Config
    publish: Publish | None = None

    def machine(self) -> Machine:
        return new_machine(self.recording, self.config, self.publish)


def _situations(span_s: float) -> dict[str, _Situation]:
    config = Config()
    one_knot = replace(config, solver=replace(config.solver, max_knots=1))
    all_knots = replace(config, solver=replace(config.solver, tolerance_um=1e-4))
    actors = SCENARIOS["strokes"].build(1, SPEED_MM_S)
    textured_knots = replace(config, solver=replace(config.solver, tolerance_um=1e-4, max_knots=20))
    strokes = record(actors, seconds=span_s)
    both_slip = record(SCENARIOS["both-slip"].build(1, SPEED_MM_S), seconds=span_s)
    still = record(SCENARIOS["rest"].build(1, SPEED_MM_S), settings=Settings(noise_mm=0.0), seconds=span_s)
    unwanted = record(tuple(replace(actor, steps_um=()) for actor in actors), seconds=span_s)
    return {
        DEFAULT: _Situation(strokes, config),
        "with telemetry": _Situation(strokes, config, lambda _: None),
        "neighbours unknown": _Situation(strokes._replace(parasitic_modes=None), config),
        "a single knot": _Situation(strokes, one_knot),
        f"all {config.solver.max_knots} knots": _Situation(strokes, all_knots),
        "a texture, 20 knots": _Situation(_textured(strokes), textured_knots),
        "both slip": _Situation(both_slip, config),
        "standing": _Situation(still, config),
        "no target": _Situation(unwanted, config),
        "no finger": _Situation(record((), seconds=span_s, timed="timer"), config),
    }


def _textured(recording: Recording) -> Recording:
    """The same touch, but the slippery finger wears a sine grating."""
    grating = GratingTarget(period_mm=8.0, angle_rad=0.4, low_um=0.0, high_um=1.0, duty_frac=0.0)
    calls = []
    for call in recording.calls:
        if call.name == "want":
            message, *when = call.arguments
            worn = {
                key: target if target == AmplitudeTarget(0.0) else grating for key, target in message.targets.items()
            }
            call = call._replace(arguments=(replace(message, targets=worn), *when))
        calls.append(call)
    return recording._replace(calls=tuple(calls))


def _paced(situation: _Situation, seconds: float, wait_until: WaitUntil) -> dict[str, float]:
    """What a pass takes that starts when its report is due."""
    limit = round(seconds / PERIOD_S)
    if limit < 1:
        return {}
    with no_garbage_collection():
        taken_us = sorted(play(situation.recording, situation.machine(), wait_until=wait_until, limit=limit))
    return {"paced_us": statistics.median(taken_us), "paced_p99_us": taken_us[int(0.99 * len(taken_us))]}


def _skipped(situation: _Situation) -> dict[str, float]:
    """The share of passes that had nothing to solve: that the situation is what its name says."""
    machine = situation.machine()
    seen: list[int] = []

    def look() -> None:
        seen.append(sum(getattr(machine.pipeline.counters, kind) for kind in _SKIPPED))

    passes = play(situation.recording, machine, before=look)
    look()
    return {"skipped_frac": (seen[-1] - seen[0]) / len(passes)}


def _watched(
    situation: _Situation, stopwatch: Stopwatch, limit: int, wait_until: WaitUntil | None = None
) -> dict[str, list[float]]:
    """By stage, the time in us that each pass spends there."""
    passes: list[dict[str, float]] = []

    def note() -> None:
        passes.append(stopwatch.taken_us())

    with stopwatch.on_every_stage():
        play(
            situation.recording,
            situation.machine(),
            before=stopwatch.reset,
            after=note,
            wait_until=wait_until,
            limit=limit,
        )
    return {stage: [taken_us[stage] for taken_us in passes] for stage in STAGES}


def _paced_stages(situation: _Situation, seconds: float, wait_until: WaitUntil) -> dict[str, dict[str, float]]:
    limit = round(seconds / PERIOD_S)
    if limit < 1:
        return {stage: {} for stage in STAGES}
    with no_garbage_collection():
        taken_us = _watched(situation, Stopwatch(), limit, wait_until)
    return {stage: {"paced_us": statistics.median(taken_us[stage])} for stage in STAGES}


def _stage_table(measured: _Measured) -> Table:
    whole, stages = measured.situations[DEFAULT], measured.stages
    rest: Mapping[str, float] = {
        name: max(whole[name] - sum(figures[name] for figures in stages.values()), 0.0)
        for name in ("hot_us", "paced_us")
        if name in whole
    }
    total: Mapping[str, float] = {name: value for name, value in whole.items() if name != "skipped_frac"}
    return Table(
        name="stages",
        title="tick: one pass of two moving fingers as Python, from the report's bytes to the frame's",
        default=WHOLE,
        rows=finite_rows([(WHOLE, total), *stages.items(), (REST, rest)]),
        compared=("hot_us", "paced_us"),
        notes=(
            "hot: pass after pass, of each its least time: their mean, and as p50 their median",
            "paced: at 88.9 Hz, asleep in between, the median",
            _STAGE_NOTE,
        ),
    )


def _situation_table(situations: Mapping[str, Mapping[str, float]]) -> Table:
    reason = why_interpreted()
    way = f"as Python, for {reason}" if reason else "as machine code (interpreted: the same passes as Python)"
    return Table(
        name="situations",
        title=f"tick: a pass where a scene needs more or less, {way}",
        default=DEFAULT,
        rows=finite_rows(list(situations.items())),
        compared=("hot_us", "paced_us"),
        notes=(
            "skipped: share of passes with nothing to solve; no finger: the timer, of which every tenth makes a pass",
        ),
    )


if __name__ == "__main__":  # what a process that runs machine code cannot do itself
    print(json.dumps(_measured(float(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))))
