"""An event loop whose time passes only when nothing else can happen: what takes minutes is run in seconds."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable
from contextvars import Context
from typing import TypeVarTuple

# Of a timer: asyncio calls one up to 1 ns early, and who then waits for the rest would wait for ever.
LEAST_S = 2e-9

_Arguments = TypeVarTuple("_Arguments")


class JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting, moves the clock."""

    t_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events = super().select(0)
        if not events:
            assert timeout is not None, "nothing is left that could wake the loop"
            self.t_s += timeout
        return events


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """A loop whose time passes only when nothing else can happen."""

    def __init__(self) -> None:
        self.selector = JumpingSelector()
        super().__init__(self.selector)

    def time(self) -> float:
        return self.selector.t_s

    def call_at(
        self, when: float, callback: Callable[[*_Arguments], object], *args: *_Arguments, context: Context | None = None
    ) -> asyncio.TimerHandle:
        now_s = self.time()
        return super().call_at(max(when, now_s + LEAST_S) if when > now_s else when, callback, *args, context=context)
