"""Comparable run times: alternatives take turns, and the least time of several repeats counts.

Other load only ever adds time, so the least is nearest to the time of the code itself.
"""

from __future__ import annotations

import contextlib
import gc
import time
from collections.abc import Callable, Iterator, Mapping

REPEATS = 7


def least_us(runs: Mapping[str, tuple[Callable[[], object], int]], repeats: int = REPEATS) -> dict[str, float]:
    """Return the least time of each alternative per operation: a call, and how many operations it has."""
    taken_us: dict[str, list[float]] = {name: [] for name in runs}
    with no_garbage_collection():
        for _ in range(repeats):
            for name, (call, count) in runs.items():
                t_start_ns = time.perf_counter_ns()
                call()
                taken_us[name].append((time.perf_counter_ns() - t_start_ns) * 1e-3 / count)
    return {name: min(times_us) for name, times_us in taken_us.items()}


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
