"""The command `hapticd bench`."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from .. import __version__
from ..errors import UsageError
from ..tools import campaigns, outputs
from ..tools.arguments import whole

if TYPE_CHECKING:
    from .tables import Table


class Part(NamedTuple):
    """One part: what it compares, and how long that takes on two cores."""

    summary: str
    minutes: float


PARTS = {
    "modes": Part("ways to interpolate a measured mode map", 0.1),
    "prediction": Part("predictions 15 ms ahead on 12 motions", 0.1),
    "solver": Part("solvers for points against general optimisers", 0.1),
    "tick": Part("time of a pass, from the report's bytes to the frame's", 0.6),
    "felt": Part("friction as asked over contacts: against its bound, and in the closed loop", 2.0),
    "firmware": Part("how fast and how well the plate follows", 0.1),
    "persons": Part("a person's friction curve by comparisons, of simulated observers", 0.9),
    "worlds": Part("what fingers get in random laboratories, touched, with and without the person's curve", 20.0),
}
APART = "worlds"  # not part of `all`, for it takes longer than all
ALL = "all"
WORLDS = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description} Without a part: the parts, with the time that each takes."
    parser.add_argument("part", nargs="?", choices=(*PARTS, ALL), metavar="PART", help=", ".join((*PARTS, ALL)))
    parser.add_argument("--worlds", type=whole(1, 1000), help=f"worlds: laboratories of each kind (default {WORLDS})")
    campaigns.add_arguments(parser, "worlds: ")
    outputs.add_json(parser)
    parser.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> None:
    if options.part is None:
        print(listing())
        return
    for name in (*campaigns.OPTIONS, APART):
        if getattr(options, name) is not None and options.part != APART:
            raise UsageError(f"--{name}: belongs to one part: write hapticd bench {APART}.")
    out = outputs.table_stream(options.json)
    figures: dict[str, dict[str, Any]] = {}
    from .tables import plain, render

    chosen = [name for name in PARTS if name != APART] if options.part == ALL else [options.part]
    for name in chosen:
        minutes = PARTS[name].minutes * ((options.worlds or WORLDS) / WORLDS if name == "worlds" else 1.0)
        print(f"measuring {name}, about {minutes:g} min ...", file=sys.stderr)
        tables = measure(name, options)
        figures[name] = {table.name: plain(table) for table in tables}
        for table in tables:
            print(render(table), end="\n\n", file=out, flush=True)
    if options.json is not None:
        written = {"machine": _machine(), "parts": figures}
        outputs.write_text(json.dumps(written, indent=2, allow_nan=False) + "\n", options.json)


def measure(name: str, options: argparse.Namespace) -> tuple[Table, ...]:
    """Run a part, the module of its name."""
    run: Callable[..., tuple[Table, ...]] = import_module(f".{name}", __package__).run
    return run(options.worlds or WORLDS, campaign=campaigns.of(options)) if name == APART else run()


def _machine() -> dict[str, str | int]:
    """The machine that the times belong to: they compare within a run, not between machines."""
    processor = platform.processor() or platform.machine()
    versions = {"hapticd": __version__, "python": platform.python_version()}
    return {**versions, "processor": processor, "cpu_count": os.cpu_count() or 1}


def listing() -> str:
    """Return the parts with the time that each takes."""
    rows = [f"  {name:<11} {part.minutes:4g} min  {part.summary}" for name, part in PARTS.items()]
    minutes = sum(part.minutes for name, part in PARTS.items() if name != APART)
    rows.append(f"  {ALL:<11} {minutes:4g} min  all of these but {APART}")
    return "\n".join(["Parts, with the time that each takes on two cores:", *rows, "\nhapticd bench PART runs one."])
