"""Fingers of a file as a scenario: CSV with the columns of `COLUMNS` and maybe `PRESSED` (README of `sim/`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np
import numpy.typing as npt

from hapticd_contract.simulated import MAX_TOUCHES, MOST_AXIS_MM, USUAL_PRESSURE_FRAC, SimulatedTouch

from ...errors import UsageError, reason
from ...regular_file import csv_rows, read_lines
from ...wire.trackpad import MAX_RECORDS
from .paths import Path, Sampled
from .pressing import RepeatedTip, SampledTip
from .scenarios import Actor, Scenario

COLUMNS = ("t_s", "finger", "x_mm", "y_mm", "target_um")
PRESSED = ("pressure_frac", "major_mm", "minor_mm", "angle_rad")  # more columns, of which the last ones may be missing
MAX_LINES = 250_000  # 20 minutes of two fingers at 100 Hz
MOST_FINGERS = 16
MOST_UM = 1000.0  # the bound of a client's target
MOST_S = 3600.0
MOST_IN_REAL_TIME = MAX_RECORDS - MAX_TOUCHES
PAUSE_S = 1.0
RECORDING_SUFFIX = ".mcap"


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
    return tuple(_repeated(actor, period_s) for actor in actors)


def _repeated(actor: Actor, period_s: float) -> Actor:
    tip = actor.fingertip and RepeatedTip(actor.fingertip, period_s)
    return replace(actor, path=actor.path and Repeated(actor.path, period_s), fingertip=tip)


def _scenario(name: str, lines: Iterable[tuple[int, str]], size_mm: Sequence[float]) -> Scenario:
    rows = csv_rows(lines)
    columns = tuple(next(rows, (0, []))[1])
    if columns[: len(COLUMNS)] != COLUMNS or columns[len(COLUMNS) :] not in (PRESSED[:number] for number in (0, 1, 4)):
        raise ValueError(
            f"does not begin with the header {','.join(COLUMNS)}: add it, with commas between cells and "
            "points in numbers."
        )
    fingers: dict[int, list[tuple[float, ...]]] = {}
    for number, row in rows:
        finger, sample = _parsed(row, columns, size_mm, f"line {number}")
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


def _parsed(
    row: Sequence[str], columns: Sequence[str], size_mm: Sequence[float], where: str
) -> tuple[int, tuple[float, ...]]:
    """Return the finger and its t_s, x_mm, y_mm, target_um and what is in `PRESSED`, NaN where a cell is empty."""
    if len(row) != len(columns):
        raise ValueError(f"{where}: has {len(row)} cells: give {', '.join(columns)}.")
    values = [_value(cell, f"{where}: {name}") for name, cell in zip(columns, row, strict=True)]
    t_s, finger, x_mm, y_mm, target_um, *pressed = values
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
    _check_pressed(pressed, where)
    return int(finger), (t_s, x_mm, y_mm, target_um, *pressed)


def _check_pressed(pressed: Sequence[float], where: str) -> None:
    bounds = (1.0, MOST_AXIS_MM, MOST_AXIS_MM, 2.0 * math.pi)
    for name, value, most in zip(PRESSED, pressed, bounds, strict=False):
        if not math.isnan(value) and not (-most if name == "angle_rad" else 0.0) <= value <= most:
            raise ValueError(f"{where}: {name} is {value:g}: give at most {most:.4g}.")
    if len(pressed) > 1 and (pressed[1] > 0.0) != (pressed[2] > 0.0):
        raise ValueError(f"{where}: has one of major_mm and minor_mm: give both, or none for a disc.")


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
    steps_um = tuple((t_s, um) for t_s, _, _, um, *_ in samples.tolist() if not math.isnan(um))
    if not steps_um:
        raise ValueError(f"finger {finger} has no target_um: give one in its first line.")
    pressed = samples[:, len(COLUMNS) - 1 :]
    tip = SampledTip.of(samples[:, 0], [_touch(row) for row in pressed.tolist()]) if pressed.size else None
    return Actor(steps_um, path=Sampled(samples[:, 0], samples[:, 1:3]), fingertip=tip)


def _touch(pressed: Sequence[float]) -> SimulatedTouch:
    """Return how a finger presses: empty cells are a resting finger's pressure, and the disc that it makes."""
    pressure_frac, *ellipse = pressed
    contact = [0.0 if math.isnan(value) else value for value in ellipse]
    return SimulatedTouch(0.0, 0.0, USUAL_PRESSURE_FRAC if math.isnan(pressure_frac) else pressure_frac, *contact)
