"""Lock-step runs of some alternatives on the same scenario and seeds, and their figures over all seeds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..config.sections import Config
from ..sim.fingers.scenarios import SCENARIOS, Actor
from ..sim.lockstep import Run, Simulation
from ..sim.plate.ground_truth import PlateSettings
from ..sim.score import rms
from ..sim.settings import Measured, Settings
from .timing import least, no_garbage_collection

SCENARIO = "strokes"
SEEDS = (1, 2, 3)
SECONDS = 10.0
DEFAULT = "hapticd"
NOTHING_UM = 1e-9  # below it is rounding


class Alternative(NamedTuple):
    """Settings of a run, and where one is given, another predictor than the default, what the daemon has measured of
    the plate built with these settings and a seed, or the fingers instead of the scenario's."""

    settings: Settings
    make_predictor: Callable[[], Any] | None = None
    measured: Callable[[PlateSettings, int], Measured] | None = None
    build: Callable[[int, float], tuple[Actor, ...]] | None = None


class FinishedRun(NamedTuple):
    """A run of an alternative, and the simulation that holds its plate."""

    name: str
    simulation: Simulation
    run: Run


Figures = Mapping[str, float]
Judge = Callable[[FinishedRun], Figures]


def changed(config: Config, changes: Mapping[str, Mapping[str, Any]]) -> Config:
    """Return the configuration with some keys of some sections replaced."""
    return replace(config, **{name: replace(getattr(config, name), **keys) for name, keys in changes.items()})


def use_predictor(simulation: Simulation, make_predictor: Callable[[], Any]) -> None:
    """Replace the predictor of all fingers to come."""
    simulation.machine.pipeline._fingers.make_predictor = make_predictor


def compared(
    alternatives: Mapping[str, Alternative],
    judge: Judge,
    *,
    seeds: Sequence[int],
    seconds: float,
    scenario: str = SCENARIO,
    timed: bool = True,
) -> list[tuple[str, Figures]]:
    """Rows of a table: each alternative's figures over all seeds, after the mean time of its passes where `timed`."""
    judged: dict[str, list[Figures]] = {name: [] for name in alternatives}
    times_us: dict[str, list[float]] = {name: [] for name in alternatives}
    with no_garbage_collection():
        for seed in seeds:
            for name, alternative in alternatives.items():
                finished, time_us = _finished(name, alternative, seed, seconds, scenario)
                judged[name].append(judge(finished))
                times_us[name].append(time_us)
    timing = {name: least(times_us[name]).figures() if timed else {} for name in alternatives}
    return [(name, {**timing[name], **over_seeds(judged[name])}) for name in alternatives]


def over_seeds(judged: Sequence[Figures]) -> Figures:
    """RMS of figures in um, means of the others."""
    columns = {name: np.array([figures[name] for figures in judged]) for name in judged[0]}
    return {name: rms(column) if name.endswith("_um") else float(np.mean(column)) for name, column in columns.items()}


def _finished(
    name: str, alternative: Alternative, seed: int, seconds: float, scenario: str
) -> tuple[FinishedRun, float]:
    """A run, and the mean time of its passes in us."""
    settings = alternative.settings
    measured = None if alternative.measured is None else alternative.measured(settings.plate, seed)
    build = alternative.build or SCENARIOS[scenario].build
    simulation = Simulation(build(seed, settings.speed_mm_s), settings, seed, measured)
    if alternative.make_predictor is not None:
        use_predictor(simulation, alternative.make_predictor)
    taken_us: list[float] = []
    simulation.machine.reports = _timed(simulation.machine.reports, taken_us)  # type: ignore[method-assign]
    simulation.run(seconds)
    return FinishedRun(name, simulation, simulation.result(scenario)), statistics.fmean(taken_us)


def _timed(method: Callable[..., Any], taken_us: list[float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        t_start_ns = time.perf_counter_ns()
        result = method(*arguments)
        taken_us.append((time.perf_counter_ns() - t_start_ns) * 1e-3)
        return result

    return timed
