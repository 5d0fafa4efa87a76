"""The command `hapticd bench`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from ..errors import UsageError
from ..tools import campaigns, outputs
from ..tools.arguments import number, whole


class Part(NamedTuple):
    """One part: what it compares, how long that takes on two cores, and whether it has error over run time."""

    summary: str
    minutes: float
    has_picture: bool = True


PARTS = {
    "modes": Part("ways to interpolate a measured mode map", 0.1),
    "prediction": Part("predictions 15 ms ahead on 15 motions", 1.5),
    "solver": Part("solvers against general optimisers", 0.8),
    "tick": Part("time of a pass, from the report's bytes to the frame's", 1.5),
    "leak": Part("what fingers get in the closed loop, by which choice", 7.0),
    "telemetry": Part("what telemetry says that fingers feel, against what they do", 4.0, has_picture=False),
    "worlds": Part("what fingers get in random laboratories, and which cause costs how much", 130.0, has_picture=False),
    "firmware": Part("how fast and how well the plate follows", 0.1),
}
APART = ("worlds",)  # not part of `all`, for it takes longer than all
ALL = "all"
WORLDS = 50  # as bench.worlds, which takes a second to import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description} Without a part: the parts, with the time that each takes."
    parser.add_argument("part", nargs="?", choices=(*PARTS, ALL), metavar="PART", help=", ".join((*PARTS, ALL)))
    parser.add_argument(
        "--seconds", type=number(0.0, 600.0), default=2.0, help="tick: of a paced measurement (default 2)"
    )
    parser.add_argument(
        "--worlds", type=whole(1, 1000), default=WORLDS, help=f"worlds: laboratories of each kind (default {WORLDS})"
    )
    parser.add_argument(
        "--traces",
        type=Path,
        metavar="F.npz",
        help="prediction: touches of real pads in place of the motions (format: hapticd/bench/README.md)",
    )
    parser.add_argument(
        "--recording",
        type=Path,
        metavar="F.mcap",
        help="prediction: a recording's touches in place of the motions",
    )
    campaigns.add_arguments(parser, "worlds: ")
    outputs.add_json(parser)
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="plot error against run time")
    parser.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> None:
    if options.part is None:
        print(listing())
        return
    if options.plot is not None and options.part != ALL and not PARTS[options.part].has_picture:
        raise UsageError(f"--plot: {options.part} has no table of error over run time: leave the option out.")
    touches = options.traces or options.recording
    if touches is not None and options.part != "prediction":
        raise UsageError("--traces and --recording belong to one part: write hapticd bench prediction.")
    if options.traces is not None and options.recording is not None:
        raise UsageError("--traces and --recording exclude each other: give one.")
    if touches is not None and options.plot is not None:
        raise UsageError("--plot: recorded touches have no table of error over run time: leave the option out.")
    for name in campaigns.OPTIONS:
        if getattr(options, name) is not None and options.part != "worlds":
            raise UsageError(f"--{name}: belongs to one part: write hapticd bench worlds.")
    from . import suite

    names = [name for name in PARTS if name not in APART] if options.part == ALL else [options.part]
    extent = suite.Extent(
        seconds=options.seconds,
        touches=suite.touches(options.traces, options.recording),
        worlds=options.worlds,
        campaign=campaigns.of(options),
    )
    suite.run({name: _minutes(name, options) for name in names}, extent, json_file=options.json, plot=options.plot)


def _minutes(name: str, options: argparse.Namespace) -> float:
    return float(PARTS[name].minutes * (options.worlds / WORLDS if name == "worlds" else 1.0))


def listing() -> str:
    """Return the parts with the time that each takes."""
    rows = [f"  {name:<11} {part.minutes:4g} min  {part.summary}" for name, part in PARTS.items()]
    minutes = sum(part.minutes for name, part in PARTS.items() if name not in APART)
    rows.append(f"  {ALL:<11} {minutes:4g} min  all of these but {' and '.join(APART)}")
    return "\n".join(["Parts, with the time that each takes on two cores:", *rows, "\nhapticd bench PART runs one."])
