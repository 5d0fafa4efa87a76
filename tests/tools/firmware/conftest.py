"""Sessions with a board in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from virtual_board import BoardLink, in_virtual_time

from hapticd.__main__ import parser
from hapticd.tools.firmware.conversation import Conversation
from hapticd.tools.firmware.program import SUBCOMMANDS


@pytest.fixture
def link() -> BoardLink:
    return BoardLink()


def converse(link: BoardLink, talk: Callable[[Conversation], Coroutine[Any, Any, Any]]) -> Any:
    """Run a coroutine function that takes a conversation over the link."""

    async def whole() -> Any:
        async with Conversation(link, "the bench") as board:  # type: ignore[arg-type]
            return await talk(board)

    return in_virtual_time(whole())


@pytest.fixture
def type_in(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs `hapticd firmware ...` over a link and returns what it printed."""

    def run(link: BoardLink, *arguments: str) -> str:
        options = parser("firmware").parse_args(["firmware", *arguments])
        converse(link, lambda board: SUBCOMMANDS[options.subcommand](board, options))
        return capsys.readouterr().out

    return run
