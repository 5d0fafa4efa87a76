"""Run times that can be compared: alternatives take turns, and each one's least time counts.

Whatever else a machine does only ever adds time, so the least of several repeats is the nearest to what the code
itself takes; the spread (greatest less least) tells how much was added. Alternatives take turns within each repeat, so
that a busy second falls on all of them.
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
    """The least time of one call, and by how much the worst repeat took longer."""

    best_us: float
    spread_us: float

    def figures(self, name: str = "time") -> dict[str, float]:
        """As figures of a row."""
        return {f"{name}_us": self.best_us, f"{name}_spread_us": self.spread_us}


def compare(runs: Mapping[str, tuple[Callable[[], object], int]], repeats: int = REPEATS) -> dict[str, Timing]:
    """Time alternatives: each is a call and the number of operations that it makes; times are per operation."""
    taken_us: dict[str, list[float]] = {name: [] for name in runs}
    with no_garbage_collection():
        for _ in range(repeats):
            for name, (call, count) in runs.items():
                t_start_ns = time.perf_counter_ns()
                call()
                taken_us[name].append((time.perf_counter_ns() - t_start_ns) * 1e-3 / count)
    return {name: least(times_us) for name, times_us in taken_us.items()}


def least(times_us: list[float]) -> Timing:
    """What repeats of the same work say."""
    return Timing(min(times_us), max(times_us) - min(times_us))


def least_by_pass(repeats_us: Sequence[Sequence[float]]) -> Timing:
    """The mean time of passes of which each was made once in every repeat: of each its least time counts."""
    best_us = statistics.fmean(min(times_us) for times_us in zip(*repeats_us, strict=True))
    return Timing(best_us, max(statistics.fmean(times_us) for times_us in repeats_us) - best_us)


@contextlib.contextmanager
def no_garbage_collection() -> Iterator[None]:
    """A collection in the middle of one alternative would be counted as its own."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def optional(module: str) -> Any | None:
    """An outside reference that the comparison can do without: the module, or None where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        return None
