"""Comparable run times: alternatives take turns, and the least time of each counts.

Other load only ever adds time, so the least of several repeats is nearest to the time of the code itself; the spread
(greatest less least) shows how much was added. Alternatives take turns within each repeat, so that load hits all alike.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

REPEATS = 7


class Timing(NamedTuple):
    """The least time of one call, and the greatest less that."""

    best_us: float
    spread_us: float

    def figures(self, name: str = "time") -> dict[str, float]:
        """Return both as figures of a row."""
        return {f"{name}_us": self.best_us, f"{name}_spread_us": self.spread_us}


def compare(runs: Mapping[str, tuple[Callable[[], object], int]], repeats: int = REPEATS) -> dict[str, Timing]:
    """Time alternatives: a call and the number of its operations each; times are per operation."""
    taken_us: dict[str, list[float]] = {name: [] for name in runs}
    with no_garbage_collection():
        for _ in range(repeats):
            for name, (call, count) in runs.items():
                t_start_ns = time.perf_counter_ns()
                call()
                taken_us[name].append((time.perf_counter_ns() - t_start_ns) * 1e-3 / count)
    return {name: least(times_us) for name, times_us in taken_us.items()}


def least(times_us: list[float]) -> Timing:
    """Return the timing of repeats of the same work."""
    return Timing(min(times_us), max(times_us) - min(times_us))


def least_by_pass(repeats_us: Sequence[Sequence[float]]) -> Timing:
    """Return the mean over all passes of each pass's least time; each repeat has every pass once."""
    best_us = statistics.fmean(min(times_us) for times_us in zip(*repeats_us, strict=True))
    return Timing(best_us, max(statistics.fmean(times_us) for times_us in repeats_us) - best_us)


@contextlib.contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Disable garbage collection: it would count as run time of one alternative."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def optional(module: str) -> Any | None:
    """Return the module of an optional library, or None where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        return None
