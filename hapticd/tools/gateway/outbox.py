"""What waits for one WebSocket to be sent."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

from aiohttp import web

MAX_UNREAD_BYTES: Final = 256 * 1024  # of replies, as the daemon has it
STATES: Final = 256  # that wait for a reader of every one: three seconds of touching


class Outbox:
    """Replies in their order, and the newest states."""

    def __init__(self) -> None:
        self.is_overfull = False
        self._replies: deque[str] = deque()
        self._states: deque[str] = deque(maxlen=STATES)
        self._unread_bytes = 0
        self._ready = asyncio.Event()

    def reply(self, text: str) -> None:
        """Queue a reply; a peer that leaves too many unread is to be disconnected (`is_overfull`)."""
        self._unread_bytes += len(text)
        self.is_overfull = self._unread_bytes > MAX_UNREAD_BYTES
        self._replies.append(text)
        self._ready.set()

    def state(self, text: str, *, newest: bool) -> None:
        """Queue a state: instead of those that wait with `newest`, else behind them; the oldest gives way."""
        if newest:
            self._states.clear()
        self._states.append(text)
        self._ready.set()

    async def write(self, socket: web.WebSocketResponse) -> None:
        """Send what is queued until the socket is closed or what is queued is too much."""
        while not socket.closed and not self.is_overfull:
            await self._ready.wait()
            self._ready.clear()
            while (self._replies or self._states) and not self.is_overfull:
                text = self._next()
                await socket.send_str(text)

    def _next(self) -> str:
        if not self._replies:
            return self._states.popleft()
        text = self._replies.popleft()
        self._unread_bytes -= len(text)
        return text
