"""Fingers of a file as a scenario: CSV with the columns of `COLUMNS` and maybe `PRESSED` (README of `sim/`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Annotated

import msgspec
import numpy as np

from hapticd_contract.base import AngleRad, Share
from hapticd_contract.simulated import MAX_TOUCHES, USUAL_PRESSURE_FRAC, AxisMm, SimulatedTouch

from ...errors import UsageError, reason
from ...regular_file import csv_rows, read_lines
from ...wire.trackpad import MAX_RECORDS
from .pressing import Repeated, SampledFinger
from .scenarios import Actor, Scenario

COLUMNS = ("t_s", "finger", "x_mm", "y_mm", "target_um")
PRESSED = ("pressure_frac", "major_mm", "minor_mm", "angle_rad")  # more columns, of which the last ones may be missing
MAX_LINES = 250_000  # 20 minutes of two fingers at 100 Hz
MOST_IN_REAL_TIME = MAX_RECORDS - MAX_TOUCHES
PAUSE_S = 1.0
RECORDING_SUFFIX = ".mcap"


class _Sample(msgspec.Struct, frozen=True):
    """A line of the file; what is missing is NaN, or that of a resting finger."""

    t_s: Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)]
    finger: Annotated[int, msgspec.Meta(ge=1, le=16)]
    x_mm: float = math.nan
    y_mm: float = math.nan
    target_um: Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)] = math.nan  # as of a client
    pressure_frac: Share = USUAL_PRESSURE_FRAC
    major_mm: AxisMm = 0.0
    minor_mm: AxisMm = 0.0
    angle_rad: AngleRad = 0.0


def read(path: FilePath, size_mm: Sequence[float]) -> Scenario:
    """Read a file of fingers on a plate of `size_mm`. Raises UsageError, which names the line."""
    try:
        return _scenario(path.name, read_lines(path, MAX_LINES), size_mm)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: cannot be read ({reason(error)}): give a CSV file.") from None
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


def read_repeated(path: FilePath, size_mm: Sequence[float]) -> tuple[Actor, ...]:
    """Read a file of fingers, CSV or a recording, for real time: they begin again PAUSE_S after the last has lifted, as
    a client may come at any time.

    Raises HapticdError, also where the pad has no room for them and a user's own.
    """
    if path.suffix == RECORDING_SUFFIX:
        from . import recorded  # with MCAP's library, which no CSV needs

        scenario = recorded.read(path)
    else:
        scenario = read(path, size_mm)
    actors = scenario.build(0, 0.0)
    if len(actors) > MOST_IN_REAL_TIME:
        raise UsageError(f"{path}: has {len(actors)} fingers: in real time at most {MOST_IN_REAL_TIME} can be played.")
    period_s = scenario.seconds + PAUSE_S
    repeated = []
    for actor in actors:
        assert isinstance(actor.path, SampledFinger)
        finger = Repeated(actor.path, period_s)
        repeated.append(replace(actor, path=finger, fingertip=actor.fingertip and finger))
    return tuple(repeated)


def _scenario(name: str, lines: Iterable[tuple[int, str]], size_mm: Sequence[float]) -> Scenario:
    rows = csv_rows(lines)
    columns = tuple(next(rows, (0, []))[1])
    if columns[: len(COLUMNS)] != COLUMNS or columns[len(COLUMNS) :] not in (PRESSED[:number] for number in (0, 1, 4)):
        raise ValueError(
            f"does not begin with the header {','.join(COLUMNS)}: add it, with commas between cells and "
            "points in numbers."
        )
    fingers: dict[int, list[_Sample]] = {}
    for number, row in rows:
        try:
            sample = _sample(row, columns, size_mm)
            samples = fingers.setdefault(sample.finger, [])
            if samples and sample.t_s <= samples[-1].t_s:
                raise ValueError(f"finger {sample.finger} is at {sample.t_s:g} s after {samples[-1].t_s:g} s: sort it.")
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
        samples.append(sample)
    if not fingers:
        raise ValueError("holds a header and no finger: add a line for each instant.")
    actors = tuple(_actor(finger, fingers[finger], columns) for finger in sorted(fingers))
    seconds = max(samples[-1].t_s for samples in fingers.values())
    return Scenario(name, "fingers of a file", seconds, lambda _seed, _speed_mm_s: actors)


def _sample(row: Sequence[str], columns: Sequence[str], size_mm: Sequence[float]) -> _Sample:
    if len(row) != len(columns):
        raise ValueError(f"has {len(row)} cells: give {', '.join(columns)}.")
    cells = {name: cell for name, cell in zip(columns, row, strict=True) if cell}
    sample = msgspec.convert(cells, _Sample, strict=False)
    if ("x_mm" in cells) != ("y_mm" in cells):
        raise ValueError("has one of x_mm and y_mm: give both, or none for a lifted finger.")
    if (sample.major_mm > 0.0) != (sample.minor_mm > 0.0):
        raise ValueError("has one of major_mm and minor_mm: give both, or none for a disc.")
    for name, edge_mm in zip(("x_mm", "y_mm"), size_mm, strict=True):
        if name in cells and not abs(getattr(sample, name)) <= edge_mm / 2.0:
            raise ValueError(f"{name} is {cells[name]}: the plate reaches from {-edge_mm / 2:g} to {edge_mm / 2:g} mm.")
    return sample


def _actor(finger: int, samples: Sequence[_Sample], columns: Sequence[str]) -> Actor:
    touches = [SimulatedTouch(*(getattr(one, name) for name in ("x_mm", "y_mm", *PRESSED))) for one in samples]
    if sum(math.isfinite(touch.x_mm) for touch in touches) < 2:
        raise ValueError(f"finger {finger} has fewer than two positions: give one for each instant that it touches.")
    steps_um = tuple((sample.t_s, sample.target_um) for sample in samples if not math.isnan(sample.target_um))
    if not steps_um:
        raise ValueError(f"finger {finger} has no target_um: give one in its first line.")
    path = SampledFinger.of(np.array([sample.t_s for sample in samples]), touches)
    return Actor(steps_um, path=path, fingertip=path if len(columns) > len(COLUMNS) else None)
