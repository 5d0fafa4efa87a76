"""What a solve takes with N fingers on M modes: one of three fingers still, half of them out of reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ..core.solver.policies import Rows
from ..core.solver.public import solve_fast
from .tables import Table, finite_rows
from .timing import REPEATS, compare

SIZES = ((1, 1), (2, 1), (1, 2), (2, 2), (3, 2), (15, 2), (2, 3), (3, 3), (5, 4), (8, 8), (15, 8))


def run(*, calls: int = 20, repeats: int = REPEATS) -> Table:
    """Time `calls` of each size, under both policies."""
    random = np.random.default_rng(23)
    ways: dict[str, tuple[Callable[[], object], int]] = {}
    for fingers, modes in SIZES:
        problems = [tuple(map(tuple, random.uniform(-1, 1, (fingers, modes)).tolist())) for _ in range(calls)]
        targets = tuple(0.0 if index % 3 == 2 else 0.5 + index % 2 * 3.0 for index in range(fingers))
        limits = (2.0,) * modes
        for policy in ("keep_zero", "priority"):
            name = f"{policy}, {fingers} on {modes}"
            ways[name] = partial(_solve_all, problems, targets, limits, policy), calls
    times = compare(ways, repeats)
    return Table(
        name="sizes",
        title="solver: time of a call with N fingers on M modes",
        default="keep_zero, 2 on 2",
        rows=finite_rows([(name, timing.figures()) for name, timing in times.items()]),
        compared=("time_us",),
    )


def _solve_all(problems: Sequence[Rows], targets: tuple[float, ...], limits: tuple[float, ...], policy: str) -> None:
    for rows in problems:
        solve_fast(rows, targets, limits, None, policy)
