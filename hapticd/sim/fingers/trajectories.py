"""Fingers of a file as a scenario: CSV with the columns t_s, finger, x_mm, y_mm, target_um (README of `sim/`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np
import numpy.typing as npt

from ...errors import UsageError, reason
from ...regular_file import read_lines
from ...wire.trackpad import MAX_RECORDS
from .hands import MAX_HANDS
from .paths import Path
from .scenarios import Actor, Scenario

COLUMNS = ("t_s", "finger", "x_mm", "y_mm", "target_um")
MAX_LINES = 250_000  # 20 minutes of two fingers at 100 Hz
MOST_FINGERS = 16
MOST_UM = 1000.0  # the bound of a client's target
MOST_S = 3600.0
MOST_IN_REAL_TIME = MAX_RECORDS - MAX_HANDS
PAUSE_S = 1.0


@dataclass(frozen=True)
class Sampled:
    """A path through samples: `at_s` (K,) rising, `at_mm` (K, 2), NaN where the finger is lifted."""

    at_s: npt.NDArray[np.float64]
    at_mm: npt.NDArray[np.float64]

    def position_mm(self, t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        lines = [np.interp(t_s, self.at_s, along_mm, left=np.nan, right=np.nan) for along_mm in self.at_mm.T]
        return np.stack(lines, axis=-1)


def read(path: FilePath, size_mm: Sequence[float]) -> Scenario:
    """Read a file of fingers on a plate of `size_mm`. Raises UsageError, which names the line."""
    try:
        return _scenario(path.name, read_lines(path, MAX_LINES), size_mm)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: cannot be read ({reason(error)}): give a CSV file.") from None
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


@dataclass(frozen=True)
class Repeated:
    """A path that begins again every `period_s`."""

    path: Path
    period_s: float

    def position_mm(self, t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return self.path.position_mm(np.mod(t_s, self.period_s))


def read_repeated(path: FilePath, size_mm: Sequence[float]) -> tuple[Actor, ...]:
    """Read a file of fingers for real time: they begin again PAUSE_S after the last has lifted, as nobody knows when a
    client comes. Raises UsageError, also where the pad has no room for them beside a user's own."""
    scenario = read(path, size_mm)
    actors = scenario.build(0, 0.0)
    if len(actors) > MOST_IN_REAL_TIME:
        raise UsageError(f"{path}: has {len(actors)} fingers: in real time at most {MOST_IN_REAL_TIME} can be played.")
    period_s = scenario.seconds + PAUSE_S
    return tuple(replace(actor, path=actor.path and Repeated(actor.path, period_s)) for actor in actors)


def _scenario(name: str, lines: Iterable[tuple[int, str]], size_mm: Sequence[float]) -> Scenario:
    rows = ((number, line.split(",")) for number, line in lines if line.strip() and not line.startswith("#"))
    _, header = next(rows, (0, []))
    if tuple(cell.strip() for cell in header) != COLUMNS:
        raise ValueError(f"does not begin with the header {','.join(COLUMNS)}: add it.")
    fingers: dict[int, list[tuple[float, ...]]] = {}
    for number, row in rows:
        finger, sample = _parsed(row, size_mm, f"line {number}")
        samples = fingers.setdefault(finger, [])
        if samples and sample[0] <= samples[-1][0]:
            late_s = samples[-1][0]
            raise ValueError(f"line {number}: finger {finger} is at {sample[0]:g} s after {late_s:g} s: sort it.")
        samples.append(sample)
    if not fingers:
        raise ValueError("holds a header and no finger: add a line for each instant.")
    actors = tuple(_actor(finger, np.array(fingers[finger])) for finger in sorted(fingers))
    seconds = max(samples[-1][0] for samples in fingers.values())
    return Scenario(name, "fingers of a file", seconds, lambda _seed, _speed_mm_s: actors)


def _parsed(row: Sequence[str], size_mm: Sequence[float], where: str) -> tuple[int, tuple[float, ...]]:
    """Return the finger and its t_s, x_mm, y_mm, target_um, NaN where a cell is empty."""
    if len(row) != len(COLUMNS):
        raise ValueError(f"{where}: has {len(row)} cells: give {', '.join(COLUMNS)}.")
    values = [_value(cell, f"{where}: {name}") for name, cell in zip(COLUMNS, row, strict=True)]
    t_s, finger, x_mm, y_mm, target_um = values
    if not 0.0 <= t_s <= MOST_S:
        raise ValueError(f"{where}: t_s is {t_s:g}: give 0 .. {MOST_S:g} s from the start of the run.")
    if not (finger.is_integer() and 1 <= finger <= MOST_FINGERS):
        raise ValueError(f"{where}: finger is {finger:g}: number fingers from 1 to {MOST_FINGERS}.")
    for name, position_mm, edge_mm in (("x_mm", x_mm, size_mm[0]), ("y_mm", y_mm, size_mm[1])):
        most_mm = edge_mm / 2.0
        if abs(position_mm) > most_mm:
            raise ValueError(
                f"{where}: {name} is {position_mm:g}: the plate reaches from {-most_mm:g} to {most_mm:g} mm."
            )
    if math.isnan(x_mm) != math.isnan(y_mm):
        raise ValueError(f"{where}: has one of x_mm and y_mm: give both, or none for a lifted finger.")
    if not math.isnan(target_um) and not 0.0 <= target_um <= MOST_UM:
        raise ValueError(f"{where}: target_um is {target_um:g}: give 0 .. {MOST_UM:g} um.")
    return int(finger), (t_s, x_mm, y_mm, target_um)


def _value(cell: str, where: str) -> float:
    if not cell.strip():
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"{where} is {cell.strip()!r}: give a number.") from None
    if not math.isfinite(value):
        raise ValueError(f"{where} is {cell.strip()}: give a finite number, or leave it empty.")
    return value


def _actor(finger: int, samples: npt.NDArray[np.float64]) -> Actor:
    if np.isfinite(samples[:, 1]).sum() < 2:
        raise ValueError(f"finger {finger} has fewer than two positions: give one for each instant that it touches.")
    steps_um = tuple((t_s, um) for t_s, _, _, um in samples.tolist() if not math.isnan(um))
    if not steps_um:
        raise ValueError(f"finger {finger} has no target_um: give one in its first line.")
    return Actor(steps_um, path=Sampled(samples[:, 0], samples[:, 1:3]))
