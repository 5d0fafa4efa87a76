"""Lock-step runs compared: some settings by name, the same scenario and seeds for all, and what is judged of each."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..config.sections import Config
from ..sim.fingers.scenarios import SCENARIOS
from ..sim.lockstep import Run, Settings, Simulation
from ..sim.score import Score
from .timing import least, no_garbage_collection

SCENARIO = "strokes"
SEEDS = (1, 2, 3)
SECONDS = 10.0
DEFAULT = "hapticd"
NOTHING_UM = 1e-9  # below it is rounding


class Played(NamedTuple):
    """A finished run, and the plate that it was played on."""

    name: str
    simulation: Simulation
    run: Run


Figures = Mapping[str, float]
Judge = Callable[[Played], Figures]


def swapped(config: Config, swap: Mapping[str, Mapping[str, Any]]) -> Config:
    """The configuration with some keys of some sections replaced."""
    return replace(config, **{name: replace(getattr(config, name), **keys) for name, keys in swap.items()})


def compared(
    alternatives: Mapping[str, Settings],
    judge: Judge,
    *,
    seeds: Sequence[int],
    seconds: float,
    scenario: str = SCENARIO,
    timed: bool = True,
) -> list[tuple[str, Figures]]:
    """Rows of a table: each alternative's figures over all seeds, after what its passes take where `timed`."""
    judged: dict[str, list[Figures]] = {name: [] for name in alternatives}
    times_us: dict[str, list[float]] = {name: [] for name in alternatives}
    with no_garbage_collection():
        for seed in seeds:
            for name, settings in alternatives.items():
                played, time_us = _play(name, settings, seed, seconds, scenario)
                judged[name].append(judge(played))
                times_us[name].append(time_us)
    timing = {name: least(times_us[name]).figures() if timed else {} for name in alternatives}
    return [(name, {**timing[name], **over_seeds(judged[name])}) for name in alternatives]


def over_seeds(judged: Sequence[Figures]) -> Figures:
    """RMS of what is in um, means of shares."""
    names = judged[0]
    columns = {name: np.array([figures[name] for figures in judged]) for name in names}
    return {
        name: math.sqrt(np.mean(column**2)) if name.endswith("_um") else float(np.mean(column))
        for name, column in columns.items()
    }


def scored(score: Score) -> Figures:
    """A score's figures, as all tables of the leak call them."""
    return {
        "leak_um": score.leak_um,
        "slip_error_um": score.slip_error_um,
        "slip_frac": score.slip_frac,
        "limited_frac": score.limited_frac,
    }


def _play(name: str, settings: Settings, seed: int, seconds: float, scenario: str) -> tuple[Played, float]:
    """A run, and the mean time of its passes in us."""
    simulation = Simulation(SCENARIOS[scenario].build(seed, settings.speed_mm_s), settings, seed)
    taken_us: list[float] = []
    simulation.machine.reports = _timed(simulation.machine.reports, taken_us)  # type: ignore[method-assign]
    simulation.run(seconds)
    return Played(name, simulation, simulation.result(scenario)), statistics.fmean(taken_us)


def _timed(method: Callable[..., Any], taken_us: list[float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        t_start_ns = time.perf_counter_ns()
        result = method(*arguments)
        taken_us.append((time.perf_counter_ns() - t_start_ns) * 1e-3)
        return result

    return timed
