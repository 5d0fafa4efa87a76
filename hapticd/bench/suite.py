"""`hapticd bench`: which parts there are, how they are run, and where their figures go."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from .. import __version__
from ..errors import HapticdError
from . import carrier, firmware, leak, modes, prediction, solver, tick
from .tables import Table, plain, render

__all__ = ["PARTS", "run"]

Part = Callable[[float], tuple[Table, ...]]  # takes the seconds of paced passes

PARTS: dict[str, Part] = {
    "modes": lambda _: (modes.run(),),
    "prediction": lambda _: (prediction.run(),),
    "solver": lambda _: (solver.run(),),
    "tick": lambda seconds: tick.run(seconds=seconds),
    "leak": lambda _: (leak.run(),),
    "firmware": lambda _: (*firmware.run(), *carrier.run()),
}


def run(part: str, *, seconds: float, json_file: str | None, plot: Path | None) -> None:
    """Run a part, or `all`: tables as they are found, then JSON and the picture where they are asked for.

    With the JSON on standard output the tables go to standard error. Raises HapticdError.
    """
    if not 0.0 <= seconds <= 600.0:  # False for NaN
        raise HapticdError(f"--seconds: {seconds:g} is out of bounds, it must be 0 .. 600.")
    for path in (plot, Path(json_file) if json_file not in (None, "-") else None):
        if path is not None and not path.absolute().parent.is_dir():
            raise HapticdError(f"{path}: its directory is missing, so it could not be written: create it first.")
    out = sys.stderr if json_file == "-" else sys.stdout
    told: dict[str, dict[str, Any]] = {}
    found: list[Table] = []
    for name, tables in _results(part, seconds):
        told[name] = {table.name: plain(table) for table in tables}
        found += tables
        _print(tables, out)
    if json_file is not None:
        _write(json.dumps({"machine": _machine(), "parts": told}, indent=2, allow_nan=False) + "\n", json_file)
    if plot is not None:
        from .plot import draw

        draw(found, plot)
        print(f"picture: {plot}", file=out)


def _results(part: str, seconds: float) -> Iterator[tuple[str, tuple[Table, ...]]]:
    for name in PARTS if part == "all" else (part,):
        yield name, PARTS[name](seconds)


def _print(tables: tuple[Table, ...], out: TextIO) -> None:
    for table in tables:
        print(render(table), end="\n\n", file=out, flush=True)


def _write(text: str, file: str) -> None:
    if file == "-":
        sys.stdout.write(text)
        return
    try:
        Path(file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise HapticdError(f"{file}: cannot be written ({error.strerror}); choose another place.") from error


def _machine() -> dict[str, str | int]:
    """Where the times were taken: they compare within a run, not between machines."""
    return {
        "hapticd": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "processor": platform.processor() or platform.machine(),
        "cpu_count": os.cpu_count() or 1,
    }
