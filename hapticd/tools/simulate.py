"""`hapticd simulate`: run a scenario in virtual time, and score it."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, reason
from ..regular_file import named_when_whole, read_bounded
from ..sim.fingers.scenarios import MOTIONS, REAL, SCENARIOS, SMOOTH, SPEED_MM_S, Scenario
from ..sim.plate.glasses import find_glass
from . import glass, outputs
from .arguments import number, suggestion, whole
from .progress import progress_bar

if TYPE_CHECKING:
    from ..sim.world_errors import WorldErrors

WORLD_BYTES = 1 << 20
IDEAL = "ideal"
LEAST_S = 0.01  # as sim.lockstep, which takes a second to import
MOST_S = 3600.0  # all of it is kept in memory until the end
DRAWN_S = 5.0
MOST_MM_S = 2000.0  # faster than any finger on a pad


def add_arguments(parser: argparse.ArgumentParser) -> None:
    scenarios = "\n".join(f"  {scenario.name:<16} {scenario.summary}" for scenario in SCENARIOS.values())
    parser.epilog = f"{parser.epilog}\n\nscenarios:\n{scenarios}"
    parser.add_argument(
        "scenario",
        metavar="SCENARIO",
        help="see below, or a CSV of your own fingers, with the columns t_s,finger,x_mm,y_mm,target_um "
        "(hapticd/sim/README.md)",
    )
    parser.add_argument("--seed", type=whole(0), default=1, help="of fingers, noise and mode map (default 1)")
    parser.add_argument("--seconds", type=number(LEAST_S, MOST_S), help="duration (default: the scenario's own)")
    parser.add_argument(
        "--speed",
        type=number(0.0, MOST_MM_S, is_above=True),
        metavar="MM_S",
        help="of a scenario's fingers (default 100); strokes with one are smooth",
    )
    parser.add_argument(
        "--motion",
        choices=MOTIONS,
        help="of strokes: real (speeds, stops and turns as of recorded hands, the default) or smooth (straight, ramps "
        "of 0.3 s; the default with --speed)",
    )
    glass.add_arguments(parser)
    parser.add_argument(
        "--world",
        metavar="WORLD",
        default=IDEAL,
        help="what is wrong: nothing (ideal, the default), what --seed draws (mild, laboratory or worst), or a JSON "
        "file of your own (hapticd/sim/README.md)",
    )
    parser.add_argument(
        "--alone", action="store_true", help="skip the comparison with the paper's scheme and perfect knowledge"
    )
    outputs.add_json(parser)
    outputs.add_file(parser, "--out", outputs.NPZ, metavar="F.npz", help="write its arrays and those compared")
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw it like the paper's figures")
    outputs.add_file(
        parser, "--record", outputs.RECORDING, metavar="F.mcap", help="record it, with the plate's ground truth"
    )
    parser.set_defaults(command=_simulate)


def _simulate(options: argparse.Namespace) -> None:
    from ..sim import lockstep, report
    from ..sim.plate.ground_truth import PlateSettings
    from ..sim.settings import Settings

    sim = glass.chosen(options)
    plate = replace(PlateSettings.of(sim.plate, sim.modes or None, sim.wiring), world=_world(options))
    scenario = _scenario(options)
    speed_mm_s = SPEED_MM_S if options.speed is None else options.speed
    settings = Settings(motion=_motion(options), speed_mm_s=speed_mm_s, plate=plate)
    t_start_s = time.perf_counter()
    with progress_bar(scenario.name) as progress:
        play: dict[str, Any] = {"settings": settings, "seed": options.seed, "seconds": options.seconds}
        if options.record is options.plot is None:
            result = lockstep.run(scenario, **play, progress=progress)
        else:
            from .record import simulated

            with _recorded_to(options.record) as part:
                result = simulated.run(scenario, part, **play, progress=progress)
                if options.plot is not None:
                    _draw(part, options.plot, f"{scenario.name}, seed {options.seed}")
    took_s = time.perf_counter() - t_start_s
    with contextlib.ExitStack() as shown:
        compared = (
            None if options.alone else report.compare(result, lambda part: shown.enter_context(progress_bar(part)))
        )
    figures = report.figures(result, compared) | {"world": asdict(plate.world)}
    print(report.table(figures), file=sys.stderr)
    print(f"{result.t_s[-1]:.1f} s of virtual time in {took_s:.2f} s", file=sys.stderr)
    if options.json is not None:
        outputs.write_json(figures, options.json)
    if options.out is not None:
        report.save(result, options.out, compared)


@contextlib.contextmanager
def _recorded_to(path: Path | None) -> Iterator[Path]:
    """Context of a recording that gets its name when it is whole, or without one is deleted."""
    if path is not None:
        with named_when_whole(path) as part:
            yield part
        return
    with tempfile.TemporaryDirectory(prefix="hapticd-simulate-") as folder:
        yield Path(folder, "run.mcap")


def _draw(recording: Path, picture: Path, title: str) -> None:
    """Draw the first seconds of a recording, so that single strokes are seen."""
    from ..files.recording.mcap_reader import open_recording
    from .record.picture import draw
    from .record.tables import tables

    found = tables(open_recording(recording))
    draw(found, picture, title=title, end_s=min(DRAWN_S, float(found["passes"]["t_s"][-1])))


def _motion(options: argparse.Namespace) -> str:
    """Return the motion of strokes. Raises UsageError where a real hand is given a speed."""
    if options.motion == REAL and options.speed is not None:
        raise UsageError("--speed: a real hand has its own: leave it out, or give --motion smooth.")
    usual = REAL if options.speed is None else SMOOTH
    return usual if options.motion is None else str(options.motion)


def _world(options: argparse.Namespace) -> WorldErrors:
    """Return the world of --world. Raises UsageError."""
    from ..sim import world_tolerances
    from ..sim.world_errors import NEUTRAL, WorldErrors

    if options.world == IDEAL:
        return NEUTRAL
    if options.world in world_tolerances.LEVELS:
        return world_tolerances.draw(options.world, options.seed)
    levels = ", ".join((IDEAL, *world_tolerances.LEVELS))
    try:
        return WorldErrors.parsed(read_bounded(Path(options.world), WORLD_BYTES).decode())
    except OSError as error:
        raise UsageError(f"--world {options.world}: {reason(error)}: give one of {levels}, or a JSON file.") from None
    except ValueError as error:
        raise UsageError(f"--world {options.world}: {error}") from None


def _scenario(options: argparse.Namespace) -> Scenario:
    """Return the named scenario, or that of a file. Raises UsageError."""
    name: str = options.scenario
    if name in SCENARIOS:
        return SCENARIOS[name]
    if not Path(name).suffix:
        raise UsageError(f"SCENARIO: there is no {name!r}{suggestion(name, SCENARIOS) or '; see --help'}")
    if options.speed is not None:
        raise UsageError("--speed: is that of a scenario's fingers: a file has its own.")
    from ..sim.fingers import trajectories

    return trajectories.read(Path(name), find_glass(glass.chosen(options).plate).size_mm)
