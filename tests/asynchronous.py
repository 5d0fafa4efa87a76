"""Test functions that are coroutines, in real or in virtual time, and bounded waits for what comes about."""

from __future__ import annotations

import asyncio
import functools
import time
from collections.abc import Callable, Coroutine
from typing import Any

from hapticd.sim.virtual_time import VirtualTimeLoop as VirtualTimeLoop

PATIENCE_S = 20.0


def asynchronous(
    test: Callable[..., Coroutine[Any, Any, None]],
    loop_factory: Callable[[], asyncio.AbstractEventLoop] | None = None,
) -> Callable[..., None]:
    """Run the test on an event loop of its own; pytest passes fixtures as for a function."""

    @functools.wraps(test)
    def run(*arguments: Any, **options: Any) -> None:
        with asyncio.Runner(loop_factory=loop_factory) as runner:
            runner.run(test(*arguments, **options))

    return run


async def until(condition: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None) -> None:
    """Turn the loop until it holds, calling `meanwhile` at each look; TimeoutError after PATIENCE_S."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.002)
            meanwhile()


def wait_for(condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
    """Poll until it holds, where no loop runs."""
    t_end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < t_end_s, "it did not come about"
        time.sleep(0.01)
