"""A loop whose time jumps: a wait for what floating point left ends, and turns of the loop take no time."""

from __future__ import annotations

import asyncio

import pytest
from virtual_board import in_virtual_time


@pytest.mark.parametrize("left_s", [5e-324, 7e-14, 1e-9, 0.5])
def test_who_waits_until_an_instant_reaches_it(left_s: float) -> None:
    async def waits() -> int:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(2.632)
        end_s, turns = loop.time() + left_s, 0
        queue: asyncio.Queue[int] = asyncio.Queue()
        while (rest_s := end_s - loop.time()) > 0.0 and turns < 5:
            turns += 1
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(queue.get(), rest_s)
        return turns

    assert in_virtual_time(waits()) < 5
