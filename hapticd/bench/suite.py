"""`hapticd bench`: which parts there are, how they are run, and where their figures go."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np

from .. import __version__
from ..errors import UsageError
from ..files.outputs import check_writable, write_text
from . import (
    carrier,
    firmware,
    knots,
    leak,
    leak_share,
    modes,
    modes_contact,
    modes_fit,
    modes_scale,
    prediction,
    recording_cost,
    singular,
    soak,
    soak_real_time,
    solver,
    solver_contacts,
    solver_sizes,
    solver_tracks,
    stability,
    tick,
)
from . import (
    leak_budget as remains,
)
from .tables import Table, plain, render

__all__ = ["PARTS", "run"]


class Extent(NamedTuple):
    """How long the parts take that can be told: seconds of paced passes, steps of the long walk, a soak's virtual hours
    or real seconds."""

    seconds: float
    steps: int
    hours: float = 1.0
    real_time_s: float | None = None


Part = Callable[[Extent], tuple[Table, ...]]

MOST_STEPS = 1_000_000_000  # half an hour

PARTS: dict[str, Part] = {
    "modes": lambda _: (modes.run(), modes_fit.run(), modes_contact.run(), modes_scale.run()),
    "prediction": lambda _: prediction.run(),
    "solver": lambda _: (solver.run(), *solver_tracks.run(), solver_contacts.run(), solver_sizes.run()),
    "knots": lambda _: knots.run(),
    "stability": lambda extent: stability.run(steps=extent.steps),
    "tick": lambda extent: tick.run(seconds=extent.seconds),
    "recording": lambda extent: (recording_cost.run(seconds=extent.seconds),),
    "leak": lambda _: (
        leak.run(),
        leak_share.run(),
        leak.both_slip(),
        singular.run(),
        leak.contact(),
        remains.run(),
    ),
    "firmware": lambda _: (*firmware.run(), *carrier.run()),
    "soak": lambda extent: (
        soak.run(extent.hours) if extent.real_time_s is None else soak_real_time.run(extent.real_time_s)
    ),
}
APART = ("soak",)  # it compares nothing and takes minutes: not one of `all`


def run(
    part: str,
    *,
    seconds: float,
    json_file: str | None,
    plot: Path | None,
    steps: int = stability.STEPS,
    hours: float = 1.0,
    real_time_s: float | None = None,
) -> None:
    """Run a part, or `all`: tables as they are found, then JSON and the picture where they are asked for.

    With the JSON on standard output the tables go to standard error. Raises HapticdError.
    """
    if not 0.0 <= seconds <= 600.0:  # False for NaN
        raise UsageError(f"--seconds: {seconds:g} is out of bounds, it must be 0 .. 600.")
    if not 0 <= steps <= MOST_STEPS:
        raise UsageError(f"--steps: {steps} is out of bounds, it must be 0 .. {MOST_STEPS}.")
    check_writable(json_file, plot)
    out = sys.stderr if json_file == "-" else sys.stdout
    told: dict[str, dict[str, Any]] = {}
    found: list[Table] = []
    for name, tables in _results(part, Extent(seconds, steps, hours, real_time_s)):
        told[name] = {table.name: plain(table) for table in tables}
        found += tables
        _print(tables, out)
    if json_file is not None:
        write_text(json.dumps({"machine": _machine(), "parts": told}, indent=2, allow_nan=False) + "\n", json_file)
    if plot is not None:
        from .plot import draw

        draw([table for table in found if _is_drawn(table)], plot)
        print(f"picture: {plot}", file=out)


def _is_drawn(table: Table) -> bool:
    """A picture shows error over time, a line over something, or the times of passes; other tables are for reading."""
    return bool(table.time or table.across or "hot_us" in table.compared)


def _results(part: str, extent: Extent) -> Iterator[tuple[str, tuple[Table, ...]]]:
    for name in [name for name in PARTS if name not in APART] if part == "all" else (part,):
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        yield name, PARTS[name](extent)


def _print(tables: tuple[Table, ...], out: TextIO) -> None:
    for table in tables:
        print(render(table), end="\n\n", file=out, flush=True)


def _machine() -> dict[str, str | int]:
    """Where the times were taken: they compare within a run, not between machines."""
    return {
        "hapticd": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "processor": platform.processor() or platform.machine(),
        "cpu_count": os.cpu_count() or 1,
    }
