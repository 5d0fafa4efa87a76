"""What fingers feel of each choice: lock-step strokes with one choice swapped at a time, beside what a pass costs.

The same trajectories, noise and plate for all; the firmware's C and the plate's true motion in the loop. A pass's time
is that of the whole way from report to frame, without the board.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..config_sections import Config
from ..sim.lockstep import Run, Settings, Simulation, paper, perfect
from ..sim.scenarios import SCENARIOS
from ..sim.score import Score, settled
from .tables import Table, finite_rows
from .timing import least, no_garbage_collection

SCENARIO = "strokes"
DEFAULT = "hapticd"
NOTHING_UM = 1e-9  # below it is rounding
PERFECT = "perfect knowledge"
PAPER = "the paper's scheme"
BOTH_SLIP = "both-slip"
SIGNS_ALONE = "signs alone"
_DIP_FRAC = 0.5  # of its target: less than this is felt as a catch


def alternatives() -> dict[str, Settings]:
    """By name, the settings of a run: hapticd's, with a single choice swapped, and the paper's."""
    ours = Settings()
    swaps: dict[str, dict[str, Mapping[str, Any]]] = {
        DEFAULT: {},
        "predictor hold": {"prediction": {"name": "hold"}},
        "predictor linear": {"prediction": {"name": "linear"}},
        "predictor kalman_ca": {"prediction": {"name": "kalman_ca"}},
        "a single knot": {"solver": {"max_knots": 1}},
        "policy paper": {"solver": {"policy": "paper"}},
        "controller pi": {"device": {"controller": "pi"}},
        "no fade": {"solver": {"fade": 0.0}},
        "effort 0.008, no fade": {"solver": {"effort": 0.008, "fade": 0.0}},
        "effort 0.02, no fade": {"solver": {"effort": 0.02, "fade": 0.0}},
    }
    told = {name: replace(ours, config=swapped(ours.config, swap)) for name, swap in swaps.items()}
    return {**told, "neighbours unknown": replace(ours, neighbours_known=False), PAPER: paper(ours)}


def swapped(config: Config, swap: Mapping[str, Mapping[str, Any]]) -> Config:
    """The configuration with some keys of some sections replaced."""
    return replace(config, **{name: replace(getattr(config, name), **keys) for name, keys in swap.items()})


def run(*, seeds: Sequence[int] = (1, 2, 3), seconds: float = 10.0, names: Sequence[str] | None = None) -> Table:
    """Compare the alternatives (all, or those in `names` and the default) on strokes of each seed."""
    chosen = {name: settings for name, settings in alternatives().items() if names is None or name in (*names, DEFAULT)}
    scores: dict[str, list[Score]] = {name: [] for name in (*chosen, PERFECT)}
    times_us: dict[str, list[float]] = {name: [] for name in chosen}
    with no_garbage_collection():
        for seed in seeds:
            for name, settings in chosen.items():
                played, time_us = _play(settings, seed, seconds)
                scores[name].append(played.score)
                times_us[name].append(time_us)
                if name == DEFAULT:
                    scores[PERFECT].append(perfect(played))
    rows = []
    for name, judged in scores.items():
        timing = least(times_us[name]).figures() if name in times_us else {}
        rows.append((name, {**timing, **_figures(judged)}))
    return Table(
        name="leak",
        title=f"leak: {SCENARIO} at 10 cm/s, 0.05 mm of noise, seeds {', '.join(map(str, seeds))}; one choice swapped",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "leak_um", "slip_error_um"),
        time="time_us",
        error="leak_um",
        floor=NOTHING_UM,
        notes=(
            "leak: RMS at the finger that should be still; slip: mean share that the other gets of its 1 um",
            "time: a pass from report to frame",
        ),
    )


def both_slip(*, seeds: Sequence[int] = (1, 2, 3), seconds: float = 10.0) -> Table:
    """Two slippery fingers on strokes: turning the phase between them, beside changing signs and the paper's scheme."""
    ours = Settings()
    signs = replace(ours, config=swapped(ours.config, {"solver": {"phase_rotation": False}}))
    chosen = {DEFAULT: ours, SIGNS_ALONE: signs, PAPER: paper(ours)}
    runs: dict[str, list[Run]] = {name: [] for name in chosen}
    times_us: dict[str, list[float]] = {name: [] for name in chosen}
    with no_garbage_collection():
        for seed in seeds:
            for name, settings in chosen.items():
                played, time_us = _play(settings, seed, seconds, BOTH_SLIP)
                runs[name].append(played)
                times_us[name].append(time_us)
    rows = [(name, {**least(times_us[name]).figures(), **_both_figures(runs[name])}) for name in chosen]
    return Table(
        name="both_slip",
        title=f"leak: {BOTH_SLIP} at 10 cm/s, 0.05 mm of noise, seeds {', '.join(map(str, seeds))}",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "slip_error_um", "dip_frac"),
        time="time_us",
        error="slip_error_um",
        floor=NOTHING_UM,
        notes=(
            "dip: share of the time that a finger has less than half of its 1 um",
            "step: of 1000 control ticks the one by which the reference changes most",
        ),
    )


def _both_figures(runs: Sequence[Run]) -> dict[str, float]:
    """How well slippery fingers are served, and how roughly the plate is asked to move."""
    dips, steps_um = [], []
    for played in runs:
        counts = settled(played.t_s, played.target_um)
        dips.append((np.abs(played.truth_um) < _DIP_FRAC * played.target_um)[counts])
        steps_um.append(np.abs(np.diff(played.reference_um, axis=0)).max(axis=1))
    return {
        "slip_error_um": math.sqrt(np.mean([played.score.slip_error_um**2 for played in runs])),
        "slip_frac": float(np.mean([played.score.slip_frac for played in runs])),
        "dip_frac": float(np.mean(np.concatenate(dips))),
        "step_um": float(np.quantile(np.concatenate(steps_um), 0.999)),
    }


def _play(settings: Settings, seed: int, seconds: float, scenario: str = SCENARIO) -> tuple[Run, float]:
    """A run, and the mean time of its passes in us."""
    simulation = Simulation(SCENARIOS[scenario].build(seed, settings.speed_mm_s), settings, seed)
    taken_us: list[float] = []
    simulation.machine.reports = _timed(simulation.machine.reports, taken_us)  # type: ignore[method-assign]
    simulation.run(seconds)
    return simulation.result(scenario), statistics.fmean(taken_us)


def _timed(method: Callable[..., Any], taken_us: list[float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        t_start_ns = time.perf_counter_ns()
        result = method(*arguments)
        taken_us.append((time.perf_counter_ns() - t_start_ns) * 1e-3)
        return result

    return timed


def _figures(judged: Sequence[Score]) -> dict[str, float]:
    """Of several seeds: RMS of what is RMS, means of shares."""
    return {
        "leak_um": math.sqrt(np.mean([score.leak_um**2 for score in judged])),
        "slip_error_um": math.sqrt(np.mean([score.slip_error_um**2 for score in judged])),
        "slip_frac": float(np.mean([score.slip_frac for score in judged])),
        "limited_frac": float(np.mean([score.limited_frac for score in judged])),
    }
