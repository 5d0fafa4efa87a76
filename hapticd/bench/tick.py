"""Run time of one pass of a touch, from a report's bytes to the frame's, as machine code and as Python.

Hot: one pass after the other, the least of several repeats. Paced: at the pad's 88.9 Hz with sleep in between, as in
the daemon, when caches and branch predictors have lost the path.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial

from msgspec import structs

from hapticd_contract.contents import Amplitude, Grating
from hapticd_contract.effects import Effect, Modulation
from hapticd_contract.surfaces import Polygon, Surface
from hapticd_contract.targets import ClientTargets, FingerTarget

from ..compiled import why_interpreted
from ..config.sections import Config
from ..daemon.machine import Machine
from ..sim.fingers.pad_ellipse import calibrated
from ..sim.fingers.pad_noise import PadNoise
from ..sim.fingers.paths import CirclePath, Touch
from ..sim.fingers.scenarios import LAND_S, SCENARIOS, SLIPPERY_UM, SPEED_MM_S, STICKY_UM, Actor
from ..sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from ..sim.plate.ground_truth import PlateSettings
from ..sim.settings import Settings, scheme_config
from . import messages
from .leak_runs import changed
from .recording import Publish, RecordedCalls, WaitUntil, new_machine, play, record, sleep_until
from .tables import Table, finite_rows
from .timing import REPEATS, least_by_pass, no_garbage_collection

PERIOD_S = 0.01125
DEFAULT = "two fingers"
ELLIPSES = "two ellipses, four modes"
CONTACTS, EIGHT_MODES = "two contacts, four modes", "two contacts, eight modes"
FIVE_FINGERS = "five fingers, three modes"
_CENTRES_MM = ((-38.0, -30.0), (-16.0, 22.0), (4.0, -26.0), (24.0, 28.0), (42.0, -20.0))
_HALF_PLATE_MM = 68.75
_SETTLE_S = 0.5  # from landing to the first pass that counts
_SKIPPED = ("skipped_no_finger", "skipped_no_target", "skipped_standing")

_Figures = dict[str, dict[str, float]]  # by situation


def run(
    *, seconds: float = 2.0, repeats: int = REPEATS, passes: int = 300, wait_until: WaitUntil = sleep_until
) -> tuple[Table, Table]:
    """Time `passes` passes hot, and `seconds` of them paced; machine code also as Python, in another process. And what
    clients' messages cost."""
    found = _measured(seconds, repeats, passes, wait_until)
    reason = why_interpreted()
    if not reason:
        for name, figures in _measured_as_python(repeats, passes).items():
            hot = {figure: value for figure, value in found[name].items() if figure.startswith("hot")}
            found[name] = {**hot, "interpreted_us": figures["hot_us"], **found[name]}
    way = f"as Python: {reason}" if reason else "as machine code (interpreted: the same passes as Python)"
    table = Table(
        name="situations",
        title=f"tick: one pass from the report's bytes to the frame's, {way}",
        default=DEFAULT,
        rows=finite_rows(list(found.items())),
        compared=("hot_us", "paced_us"),
        notes=(
            "hot: passes in a row, the least time of each: mean, and p50; paced: at 88.9 Hz, asleep in between",
            "skipped: share of passes with nothing to solve; no finger: the timer, of which every tenth makes a pass",
        ),
    )
    return table, messages.table(repeats)


def _measured(seconds: float, repeats: int, passes: int, wait_until: WaitUntil = sleep_until) -> _Figures:
    situations = _situations(LAND_S + _SETTLE_S + max(seconds, passes * PERIOD_S))
    hot_us: dict[str, list[list[float]]] = {name: [] for name in situations}
    with no_garbage_collection():
        for _ in range(repeats):
            for name, situation in situations.items():
                hot_us[name].append(play(situation.recording, situation.machine(), limit=passes))
    return {
        name: {
            **least_by_pass(hot_us[name]).figures("hot"),
            "hot_p50_us": statistics.median(map(min, zip(*hot_us[name], strict=True))),
            **_paced(situation, seconds, wait_until),
            **_skipped(situation),
        }
        for name, situation in situations.items()
    }


def _measured_as_python(repeats: int, passes: int) -> _Figures:
    done = subprocess.run(
        [sys.executable, "-P", "-m", __name__, str(repeats), str(passes)],
        env={**os.environ, "HAPTICD_PURE": "1"},
        stdout=subprocess.PIPE,
        check=True,
    )
    return dict(json.loads(done.stdout))


@dataclass(frozen=True, slots=True)
class _Situation:
    """Fingers and targets as a recording, and the configuration of the machine that replays it."""

    recording: RecordedCalls
    config: Config
    publish: Publish | None = None

    def machine(self) -> Machine:
        return new_machine(self.recording, self.config, self.publish)


def _situations(span_s: float) -> dict[str, _Situation]:
    config = Config()
    textured_config = changed(config, {"solver": {"tolerance_um": 1e-4, "max_knots": 20}})
    actors = SCENARIOS["strokes"].build(1, SPEED_MM_S)
    strokes = record(actors, seconds=span_s)
    both_slip = record(SCENARIOS["both-slip"].build(1, SPEED_MM_S), seconds=span_s)
    still = record(SCENARIOS["rest"].build(1, SPEED_MM_S), settings=Settings(noise=PadNoise(0.0)), seconds=span_s)
    no_finger = partial(record, (), seconds=span_s, timed="timer")
    without_target = record(tuple(replace(actor, steps_um=()) for actor in actors), seconds=span_s)
    three_modes = Settings(plate=PlateSettings.of(REFERENCE, 3))
    contacts, eight_modes = (Settings(plate=PlateSettings.of(plate)) for plate in (FINGERTIP, WIDE))
    ellipses = replace(contacts, config=calibrated(contacts.config))
    five_fingers = record(_five_fingers(), settings=three_modes, seconds=span_s)
    return {
        DEFAULT: _Situation(strokes, config),
        "with telemetry": _Situation(strokes, config, lambda _: None),
        "a single knot": _Situation(strokes, changed(config, {"solver": {"max_knots": 1}})),
        "a texture, 20 knots": _Situation(_textured(strokes), textured_config),
        "both slip": _Situation(both_slip, config),
        "both slip on 8 surfaces": _Situation(_on_surfaces(both_slip, 8), config),
        "both slip on 64 surfaces": _Situation(_on_surfaces(both_slip, 64), config),
        "8 surfaces, one modulated at 40 Hz": _Situation(_on_surfaces(both_slip, 8, 40.0), config),
        "64 surfaces, one modulated at 40 Hz": _Situation(_on_surfaces(both_slip, 64, 40.0), config),
        "the whole plate at 40 Hz": _Situation(_on_surfaces(both_slip, 8, 40.0, on=None), config),
        "the whole plate at 250 Hz": _Situation(_on_surfaces(both_slip, 8, 250.0, on=None), config),
        FIVE_FINGERS: _Situation(five_fingers, scheme_config(three_modes)),
        CONTACTS: _Situation(record(actors, settings=contacts, seconds=span_s), scheme_config(contacts)),
        **{
            f"{count} contacts, four modes": _Situation(
                record(SCENARIOS[name].build(1, SPEED_MM_S), settings=contacts, seconds=span_s), scheme_config(contacts)
            )
            for count, name in (("three", "two-of-three"), ("five", "two-of-five"))
        },
        ELLIPSES: _Situation(record(actors, settings=ellipses, seconds=span_s), scheme_config(ellipses)),
        EIGHT_MODES: _Situation(
            record(actors, settings=eight_modes, seconds=span_s),
            changed(scheme_config(eight_modes), {"device": {"baud": Config().device.fast_baud}}),
        ),
        "standing": _Situation(still, config),
        "no target": _Situation(without_target, config),
        "no finger": _Situation(no_finger(), config),
        "no finger, 64 surfaces": _Situation(no_finger(changed=partial(_surfaces, count=64)), config),
        "no finger, 64 surfaces, 40 Hz": _Situation(
            no_finger(changed=partial(_surfaces, count=64, modulated_hz=40.0)), config
        ),
    }


def _five_fingers() -> tuple[Actor, ...]:
    """Small circles all over the plate; two fingers are still: three on three modes would leave zero alone."""
    return tuple(
        Actor(
            ((LAND_S, STICKY_UM if index < 2 else SLIPPERY_UM),),
            path=Touch(CirclePath(centre_mm, 8.0, SPEED_MM_S, float(index)), LAND_S),
        )
        for index, centre_mm in enumerate(_CENTRES_MM)
    )


def _textured(recording: RecordedCalls) -> RecordedCalls:
    """The same touch; the slippery finger's target is a sine grating."""
    grating = Grating(period_mm=8.0, angle_rad=0.4, low_um=0.0, high_um=1.0, duty_frac=0.0)

    def textured(message: ClientTargets) -> ClientTargets:
        targets = [
            one if one.amplitude_um == 0.0 else FingerTarget(one.finger, grating=grating) for one in message.targets
        ]
        return structs.replace(message, targets=tuple(targets))

    return recording.with_messages(textured)


def _on_surfaces(
    recording: RecordedCalls, count: int, modulated_hz: float = 0.0, on: str | None = "0 0"
) -> RecordedCalls:
    """The same touch without targets on `_surfaces`."""
    return recording.with_messages(lambda message: _surfaces(message, count, modulated_hz, on))


def _surfaces(message: ClientTargets, count: int, modulated_hz: float = 0.0, on: str | None = "0 0") -> ClientTargets:
    """The message with tiles that leave no gap, each a little more or less slippery than the next, for its targets; one
    of them moves over the others, and is modulated."""
    columns = 2 ** math.ceil(math.log2(count) / 2)
    rows = count // columns
    width_mm, height_mm = 2.0 * _HALF_PLATE_MM / columns, 2.0 * _HALF_PLATE_MM / rows
    x_mm, y_mm = 0.5 * width_mm, 0.5 * height_mm
    tile = Polygon(((-x_mm, -y_mm), (x_mm, -y_mm), (x_mm, y_mm), (-x_mm, y_mm)))
    surfaces = {
        f"{column} {row}": Surface.of(
            Amplitude(SLIPPERY_UM if (column + row) % 2 else 0.8 * SLIPPERY_UM),
            tile,
            ((column + 0.5) * width_mm - _HALF_PLATE_MM, (row + 0.5) * height_mm - _HALF_PLATE_MM),
            name=f"{column} {row}",
        )
        for column in range(columns)
        for row in range(rows)
    }
    surfaces["0 0"] = structs.replace(surfaces["0 0"], velocity_mm_s=(20.0, 15.0), z=1)
    effects = (Effect.of(Modulation(modulated_hz, 0.5), on, name="hum"),) if modulated_hz > 0.0 else ()
    return structs.replace(message, targets=(), surfaces=tuple(surfaces.values()), effects=effects)


def _paced(situation: _Situation, seconds: float, wait_until: WaitUntil) -> dict[str, float]:
    limit = round(seconds / PERIOD_S)
    if limit < 1:
        return {}
    with no_garbage_collection():
        taken_us = sorted(play(situation.recording, situation.machine(), wait_until=wait_until, limit=limit))
    return {"paced_us": statistics.median(taken_us), "paced_p99_us": taken_us[int(0.99 * len(taken_us))]}


def _skipped(situation: _Situation) -> dict[str, float]:
    """Share of passes with nothing to solve: evidence that the situation is as named."""
    machine = situation.machine()
    skipped: list[int] = []

    def note() -> None:
        skipped.append(sum(getattr(machine.pipeline.counters, kind) for kind in _SKIPPED))

    passes = play(situation.recording, machine, before=note)
    note()
    return {"skipped_frac": (skipped[-1] - skipped[0]) / len(passes)}


if __name__ == "__main__":  # the process that runs as Python
    print(json.dumps(_measured(0.0, int(sys.argv[1]), int(sys.argv[2]))))
