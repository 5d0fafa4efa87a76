"""The daemon, as all WebSockets and OSC senders share it: sockets, its states, and the names in use."""

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


class SharedDaemon:
    """Sockets to the daemon, and each state as JSON for those that follow.

    `names` are the clients' names in use: each peer has one, so that no page speaks for another.
    """

    def __init__(self, find: Callable[[], Endpoint]) -> None:
        self.find = find
        self.names: set[str] = set()
        self._context = zmq.asyncio.Context()
        self._followers: dict[object, Take] = {}
        self._reading: asyncio.Task[None] | None = None

    def connected(self, kind: int, name: str) -> zmq.asyncio.Socket:
        """Return a socket to the daemon's of this name, which queues nothing without one. Raises the client library's
        HapticdError where there can be none."""
        socket = self._context.socket(kind)
        socket.linger = 0
        socket.immediate = True
        self.find().connect(socket, name)
        return socket

    def follow(self, follower: object, take: Take) -> None:
        """Hand states to a follower from now on; they are received only while there is one."""
        self._followers[follower] = take
        if self._reading is None:
            self._reading = asyncio.ensure_future(self._read())

    def leave(self, follower: object) -> None:
        """Hand no more states to a follower."""
        if self._followers.pop(follower, None) is not None and not self._followers and self._reading is not None:
            self._reading.cancel()
            self._reading = None

    def close(self) -> None:
        """Close all sockets."""
        self._context.destroy(linger=0)

    async def _read(self) -> None:
        socket = self._context.socket(zmq.SUB)
        try:
            socket.rcvhwm = STATES
            socket.subscribe(b"")
            self.find().connect(socket, "telemetry")
            while True:
                text = text_of(await socket.recv())
                for take in tuple(self._followers.values()):
                    take(text)
        finally:
            with contextlib.suppress(zmq.ZMQError):
                socket.close(linger=0)
