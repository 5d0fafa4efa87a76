"""Run time of one pass of a touch, from a report's bytes to the frame's; as Python with HAPTICD_PURE=1.

Hot: one pass after the other, the least of several repeats. Paced: at the pad's 88.9 Hz with sleep in between, as in
the daemon, when caches and branch predictors have lost the path.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from ..compiled import why_interpreted
from ..config.sections import Config
from ..daemon.board_gateway import FAST_BAUD
from ..sim.fingers.pad_ellipse import calibrated
from ..sim.fingers.pad_noise import PadNoise
from ..sim.fingers.scenarios import LAND_S, SCENARIOS, SPEED_MM_S, Actor
from ..sim.plate.glasses import FINGERTIP, WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.settings import Settings, scheme_config
from .recording import RecordedCalls, WaitUntil, new_machine, play, record, sleep_until
from .tables import Table
from .timing import REPEATS, no_garbage_collection

PERIOD_S = 0.01125
_SETTLE_S = 0.5  # from landing to the first pass that counts


def run(
    *, seconds: float = 2.0, repeats: int = REPEATS, passes: int = 300, wait_until: WaitUntil = sleep_until
) -> tuple[Table]:
    """Time `passes` passes hot, and `seconds` of them paced."""
    situations = _situations(LAND_S + _SETTLE_S + max(seconds, passes * PERIOD_S))
    hot_us: dict[str, list[list[float]]] = {name: [] for name in situations}
    found = {}
    with no_garbage_collection():
        for _ in range(repeats):
            for name, (recording, config, publish) in situations.items():
                hot_us[name].append(play(recording, new_machine(recording, config, publish), limit=passes))
        for name, (recording, config, publish) in situations.items():
            least_us = [*map(min, zip(*hot_us[name], strict=True))]
            found[name] = {"hot_us": statistics.fmean(least_us), "hot_p50_us": statistics.median(least_us)}
            if limit := round(seconds / PERIOD_S):
                machine = new_machine(recording, config, publish)
                taken_us = sorted(play(recording, machine, wait_until=wait_until, limit=limit))
                p99_us = taken_us[int(0.99 * len(taken_us))]
                found[name] |= {"paced_us": statistics.median(taken_us), "paced_p99_us": p99_us}
    way = f"as Python: {why_interpreted()}" if why_interpreted() else "as machine code"
    title = f"tick: one pass from the report's bytes to the frame's, {way}"
    note = "hot: passes in a row, the least time of each: mean, and p50; paced: at 88.9 Hz, asleep in between"
    return (Table("tick", title, found, (note,)),)


class _Situation(NamedTuple):
    """Fingers and targets as a recording, and the machine that replays it."""

    recording: RecordedCalls
    config: Config
    publish: Callable[[bytes], None] | None = None


def _situations(span_s: float) -> dict[str, _Situation]:
    config, points = Config(), Settings()
    contacts, eight_modes = (Settings(plate=PlateSettings.of(plate)) for plate in (FINGERTIP, WIDE))
    ellipses = replace(contacts, config=calibrated(contacts.config))
    strokes = SCENARIOS["strokes"].build(1, SPEED_MM_S)

    def played(settings: Settings, actors: tuple[Actor, ...] = strokes, timed: str = "reports") -> _Situation:
        config = scheme_config(settings)
        if settings is eight_modes:
            config = replace(config, device=replace(config.device, baud=FAST_BAUD))
        return _Situation(record(actors, settings=settings, seconds=span_s, timed=timed), config)

    def of(scenario: str, settings: Settings = points) -> _Situation:
        return played(settings, SCENARIOS[scenario].build(1, SPEED_MM_S))

    two_fingers = played(points)._replace(config=config)
    return {
        "two fingers": two_fingers,
        "with telemetry": two_fingers._replace(publish=lambda _: None),
        "both slip": of("both-slip"),
        "two contacts, four modes": played(contacts),
        "two ellipses, four modes": played(ellipses),
        "five contacts, four modes": of("two-of-five", contacts),
        "two contacts, eight modes": played(eight_modes),
        "five contacts, eight modes": of("two-of-five", eight_modes),
        "standing": of("rest", Settings(noise=PadNoise(0.0))),
        "no target": played(points, tuple(replace(actor, steps_um=()) for actor in strokes)),
        "no finger": played(points, (), "timer"),
    }
