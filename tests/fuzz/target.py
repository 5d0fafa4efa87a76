"""What a fuzz target is: a decoder with the promises it keeps for any bytes, and what it may cost.

Cost is counted, not timed: lines of Python executed, the standard library's included, and bytes held at the worst
moment. Both stay below a line `fixed + per_byte * len(data)`, which is the bound that each harness states.
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

CORPORA = Path(__file__).parents[1] / "data"


class Cost(NamedTuple):
    """Lines executed and the peak of memory, of one input or as a bound."""

    lines: float
    peak_bytes: float


@dataclass(frozen=True, slots=True)
class Target:
    """One decoder. `check` takes any bytes and raises only where a promise is broken; its documented error is caught.
    It returns whether the bytes meant anything.

    `seeds` are sound inputs made by the project's own encoders, next to those of the corpus.
    """

    name: str
    check: Callable[[bytes], bool]
    fixed: Cost
    per_byte: Cost
    seeds: Callable[[], dict[str, bytes]] = dict
    max_len: int = 2048

    @property
    def corpus(self) -> Path:
        return CORPORA / f"fuzz-{self.name}"

    def inputs(self) -> dict[str, bytes]:
        """The seeds and the corpus."""
        return self.seeds() | {f"kept {path.name}": path.read_bytes() for path in sorted(self.corpus.iterdir())}

    def allowed(self, n: int) -> Cost:
        """The bound for an input of `n` bytes."""
        return Cost(self.fixed.lines + n * self.per_byte.lines, self.fixed.peak_bytes + n * self.per_byte.peak_bytes)


def measured(check: Callable[[bytes], object], data: bytes) -> Cost:
    """What one input costs. It runs three times: the first pays for what is only built once."""
    check(data)
    count = 0

    def trace(_frame: FrameType, event: str, _argument: Any) -> Callable[..., Any]:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()  # coverage's own: it misses nothing that it has not seen in the first run
    sys.settrace(trace)
    try:
        check(data)
    finally:
        sys.settrace(before)
    tracemalloc.start()
    try:
        check(data)
        return Cost(count, tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()
