"""A conversation that is cancelled."""

from __future__ import annotations

import asyncio

import pytest
from virtual_board import BoardLink, in_virtual_time

from hapticd.sim.board.virtual_link import LINK_S
from hapticd.tools.firmware.conversation import Conversation


@pytest.mark.parametrize("turns", range(6))
def test_a_cancellation_that_comes_with_a_message_is_not_lost(link: BoardLink, turns: int) -> None:
    async def listens_for_ever() -> None:
        async with Conversation(link, "the bench") as board:  # type: ignore[arg-type]
            link.says = cancelling
            while True:
                await board.receive(1.0)

    def cancelling(said: bytes) -> bytes:
        link.says = lambda data: data
        asyncio.get_running_loop().call_later(LINK_S, cancel, turns)
        return said

    def cancel(left: int) -> None:
        if left:
            asyncio.get_running_loop().call_soon(cancel, left - 1)
        else:
            listening.cancel()

    listening: asyncio.Task[None]

    async def whole() -> bool:
        nonlocal listening
        listening = asyncio.ensure_future(listens_for_ever())
        await asyncio.wait((listening,), timeout=2.0)
        return listening.cancelled()

    assert in_virtual_time(whole())
