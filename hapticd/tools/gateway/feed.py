"""The daemon's states, read once for all WebSockets, and only while one follows them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

import zmq
import zmq.asyncio

from hapticd_client.endpoint import Endpoint

from .messages import text_of

STATES: Final = 4096  # that wait for a reader of every one: some 40 s of touching, as the Python client has it

Take = Callable[[str], None]


class Feed:
    """Hands each state, as JSON, to those that follow."""

    def __init__(self, context: zmq.asyncio.Context, endpoint: Endpoint) -> None:
        self._context = context
        self._endpoint = endpoint
        self._followers: dict[int, Take] = {}
        self._reading: asyncio.Task[None] | None = None

    def follow(self, number: int, take: Take) -> None:
        """Hand states to a peer from now on."""
        self._followers[number] = take
        if self._reading is None:
            self._reading = asyncio.ensure_future(self._read())

    def leave(self, number: int) -> None:
        """Hand no more states to a peer."""
        if self._followers.pop(number, None) is not None and not self._followers and self._reading is not None:
            self._reading.cancel()
            self._reading = None

    async def _read(self) -> None:
        socket = self._context.socket(zmq.SUB)
        try:
            socket.rcvhwm = STATES
            socket.subscribe(b"")
            self._endpoint.connect(socket, "telemetry")
            while True:
                text = text_of(await socket.recv())
                for take in tuple(self._followers.values()):
                    take(text)
        finally:
            with contextlib.suppress(zmq.ZMQError):
                socket.close(linger=0)
