"""An event loop whose time passes only when nothing else can happen: what takes minutes is run in seconds."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

# Of a turn of the loop: asyncio calls a timer up to 1 ns early, and who then waits for the rest would wait for ever.
LEAST_S = 1e-9

_Result = TypeVar("_Result")


class JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting, moves the clock."""

    t_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events = super().select(0)
        if not events:
            assert timeout is not None, "nothing is left that could wake the loop"
            self.t_s += max(timeout, LEAST_S) if timeout > 0.0 else 0.0
        return events


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """A loop whose time passes only when nothing else can happen."""

    def __init__(self) -> None:
        self.selector = JumpingSelector()
        super().__init__(self.selector)

    def time(self) -> float:
        return self.selector.t_s


def in_virtual_time(what: Coroutine[Any, Any, _Result]) -> _Result:
    """Run a coroutine to its end."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(what)
