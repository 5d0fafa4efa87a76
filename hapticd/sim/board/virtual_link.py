"""A `SerialLink` for a conversation, with a simulated board at the other end and time that is the loop's own."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator

LINK_S = 0.002


class VirtualLink(ABC):
    """A line to a board of `receive` and `advance`, whose time passes while the line is open."""

    step_s = 0.002
    _is_open = False

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_bytes: Callable[[bytes], None],
        on_link: Callable[[bool, str], None],
    ) -> None:
        self._loop, self._on_bytes, self._on_link, self._is_open = loop, on_bytes, on_link, True
        on_link(True, "")
        loop.call_soon(self._step)

    def write(self, data: bytes) -> bool:
        if self._is_open:
            self._loop.call_later(LINK_S, self.receive, data)
        return self._is_open

    def pull(self) -> None:
        """Be the cable in a hand."""
        self._is_open = False
        self._on_link(False, "the cable was pulled")

    async def drained(self, within_s: float) -> None:
        await asyncio.sleep(within_s)

    def close(self) -> None:
        self._is_open = False

    @abstractmethod
    def receive(self, data: bytes) -> None:
        """Let the board have these bytes."""

    @abstractmethod
    def advance(self) -> Iterator[bytes]:
        """Let a step of time pass, and yield what the board sends."""

    def _step(self) -> None:
        if self._is_open:
            for said in self.advance():
                self._loop.call_later(LINK_S, self._deliver, said)
            self._loop.call_later(self.step_s, self._step)

    def _deliver(self, said: bytes) -> None:
        if self._is_open:
            self._on_bytes(said)
