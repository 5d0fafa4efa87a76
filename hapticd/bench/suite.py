"""Parts of `hapticd bench`, and where their figures go: tables, JSON, a picture."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import __version__
from ..design.campaign import TaskRunner, one_by_one
from ..errors import UsageError
from ..tools.outputs import table_stream, write_text
from ..tools.touches import Trace, recorded
from . import (
    felt,
    felt_asked,
    firmware,
    leak,
    modes,
    prediction,
    prediction_traces,
    solver,
    telemetry,
    tick,
    worlds,
)
from .tables import Table, plain, render


class Extent(NamedTuple):
    """Lengths of the parts that have one: seconds of paced passes; the recorded touches for predictions; the
    laboratories of each kind, and who plays them."""

    seconds: float
    touches: list[Trace] | None = None
    worlds: int = worlds.WORLDS
    campaign: TaskRunner = one_by_one


_Runner = Callable[[Extent], tuple[Table, ...]]


def _predictions(recorded_touches: list[Trace] | None) -> tuple[Table, ...]:
    return prediction.run() if recorded_touches is None else prediction_traces.run(recorded_touches)


PARTS: dict[str, _Runner] = {
    "modes": lambda _: (modes.run(),),
    "prediction": lambda extent: _predictions(extent.touches),
    "solver": lambda _: (solver.run(), felt.run()),
    "tick": lambda extent: tick.run(seconds=extent.seconds),
    "leak": lambda _: (leak.run(), leak.contact(), felt_asked.run()),
    "telemetry": lambda _: (telemetry.run(),),
    "worlds": lambda extent: worlds.run(worlds=extent.worlds, campaign=extent.campaign),
    "firmware": lambda _: firmware.run(),
}


def touches(traces_file: Path | None, recording: Path | None) -> list[Trace] | None:
    """Return the recorded touches of one of the files, if one is given. Raises HapticdError."""
    if traces_file is not None:
        return prediction_traces.load(traces_file)
    return None if recording is None else recorded(recording)


def run(minutes: Mapping[str, float], extent: Extent, *, json_file: str | None, plot: Path | None) -> None:
    """Run the parts named by `minutes`, which says how long each takes: print each table, then write JSON and the
    picture if requested.

    With the JSON on standard output the tables go to standard error. Raises HapticdError.
    """
    out = table_stream(json_file)
    figures: dict[str, dict[str, Any]] = {}
    found: list[Table] = []
    for name, tables in _results(minutes, extent):
        figures[name] = {table.name: plain(table) for table in tables}
        found += tables
        for table in tables:
            print(render(table), end="\n\n", file=out, flush=True)
    if json_file is not None:
        write_text(json.dumps({"machine": _machine(), "parts": figures}, indent=2, allow_nan=False) + "\n", json_file)
    drawn = [table for table in found if _is_drawn(table)]
    if plot is not None and not drawn:
        raise UsageError(f"--plot: {', '.join(minutes)} has no table of error over run time; leave the option out.")
    if plot is not None:
        from .plot import draw

        draw(drawn, plot)
        print(f"picture: {plot}", file=out)


def _is_drawn(table: Table) -> bool:
    """A picture shows error over run time, or the run times of passes."""
    return bool(table.time or "hot_us" in table.compared)


def _results(minutes: Mapping[str, float], extent: Extent) -> Iterator[tuple[str, tuple[Table, ...]]]:
    left_min = sum(minutes.values())
    for place, (name, takes_min) in enumerate(minutes.items(), 1):
        in_all = f", all about {left_min:g} min" if len(minutes) > 1 else ""
        print(f"measuring {name} ({place} of {len(minutes)}, about {takes_min:g} min{in_all}) ...", file=sys.stderr)
        yield name, PARTS[name](extent)
        left_min -= takes_min


def _machine() -> dict[str, str | int]:
    """The machine that the times belong to: they compare within a run, not between machines."""
    return {
        "hapticd": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "processor": platform.processor() or platform.machine(),
        "cpu_count": os.cpu_count() or 1,
    }
