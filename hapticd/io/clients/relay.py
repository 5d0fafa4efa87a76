"""Relay between one client's connection and ZeroMQ, with a bound on the bytes that the client leaves unread."""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
from typing import NamedTuple, Protocol

from .zmtp import Inbound, ProtocolError

CHUNK_BYTES = 65_536


class UnreadBytes(NamedTuple):
    """Most bytes that one connection, one user and all of them may leave unread, besides the kernel's buffers."""

    connection: int
    user: int
    in_all: int


class Owner(Protocol):
    """What a relay needs of the gate."""

    loop: asyncio.AbstractEventLoop
    counters: dict[str, int]

    def unwatch(self, one: socket.socket) -> None:
        """Remove a socket from the loop, which may be closed."""

    def forget(self, relay: Relay) -> None:
        """Take note that a connection is closed."""

    def leaves_too_much(self, relay: Relay, most: UnreadBytes) -> bool:
        """Return whether a connection that leaves bytes unread has to be closed."""


class Relay:
    """One client's connection and its counterpart to ZeroMQ, each read only while the other takes the bytes.

    libzmq goes on to answer the requests that a lost client has left, and frees the answers only when they are read. So
    that counterpart is read to its end.
    """

    def __init__(
        self,
        owner: Owner,
        number: int,
        user: str,
        outer: socket.socket,
        inner: socket.socket,
        inbound: Inbound,
        most_unread: UnreadBytes | None,
    ) -> None:
        self.number = number
        self.user = user
        self.t_lost_s = math.inf
        self.most_unread = most_unread
        self.to_client = bytearray()
        self.relayed_bytes = 0
        self._is_ending = False
        self._to_daemon = b""
        self._owner, self._loop = owner, owner.loop
        self._outer: socket.socket | None = outer
        self._inner = inner
        self._inbound = inbound
        self._loop.add_reader(outer, self._from_client)
        self._loop.add_reader(inner, self._from_daemon)

    def _from_client(self) -> None:
        assert self._outer is not None
        try:
            data = self._outer.recv(CHUNK_BYTES)
            self._to_daemon = unsent(self._inner, self._inbound(data))
        except BlockingIOError:
            return
        except ProtocolError:
            self._lose("broken")
        except OSError:
            self._lose()
        else:
            if not data:
                self._lose()
            elif self._to_daemon:
                self._loop.remove_reader(self._outer)
                self._loop.add_writer(self._inner, self._push_to_daemon)

    def _push_to_daemon(self) -> None:
        try:
            self._to_daemon = unsent(self._inner, self._to_daemon)
        except OSError:
            self._close()
            return
        if not self._to_daemon:
            self._loop.remove_writer(self._inner)
            if self._outer is not None:
                self._loop.add_reader(self._outer, self._from_client)

    def _from_daemon(self) -> None:
        try:
            data = self._inner.recv(CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        was_behind = bool(self.to_client)
        self.relayed_bytes += len(data)
        self._to_outer(data)
        if not data and (self._outer is None or not self.to_client):
            self._close()
        elif self._outer is None or not self.to_client:
            return
        elif not data:  # ZeroMQ is done; the client still has to take what waits
            self._is_ending = True
            self._loop.remove_reader(self._inner)
            self._loop.add_writer(self._outer, self._push_to_client)
        elif self.most_unread is not None and self._owner.leaves_too_much(self, self.most_unread):
            self._lose("unread")
        elif not was_behind:
            self._loop.add_writer(self._outer, self._push_to_client)
            if self.most_unread is None:
                self._loop.remove_reader(self._inner)

    def _push_to_client(self) -> None:
        assert self._outer is not None
        try:
            del self.to_client[: self._outer.send(self.to_client[:CHUNK_BYTES])]
        except BlockingIOError:
            return
        except OSError:
            self._lose()
            return
        if self.to_client:
            return
        if self._is_ending:
            self._close()
        else:
            self._loop.remove_writer(self._outer)
            self._loop.add_reader(self._inner, self._from_daemon)

    def _to_outer(self, data: bytes) -> None:
        """Send to the client, behind what waits already; without a client, nothing waits."""
        if self._outer is None:
            return
        try:
            self.to_client += data if self.to_client else unsent(self._outer, data)
        except OSError:
            self._lose()

    def _lose(self, cause: str | None = None) -> None:
        """Close the client's side, and read the other to its end."""
        if cause is not None:
            self._owner.counters[cause] += 1
        self.to_client.clear()
        if self._outer is None:
            return
        self._owner.unwatch(self._outer)
        self._outer.close()
        self._outer = None
        self.t_lost_s = self._loop.time()
        self._to_daemon = b""
        self._loop.remove_writer(self._inner)
        self._loop.add_reader(self._inner, self._from_daemon)
        with contextlib.suppress(OSError):
            self._inner.shutdown(socket.SHUT_WR)

    def pump(self) -> bool:
        """Relay some bytes to the client; return whether there were any."""
        if self.to_client:
            self._push_to_client()
            return True
        before = self.relayed_bytes
        self._from_daemon()
        return self.relayed_bytes > before

    def finish(self) -> None:
        """Pass on what ZeroMQ has sent, as far as the client takes it at once, and close."""
        try:
            while data := self._inner.recv(CHUNK_BYTES):
                self.to_client += data
        except OSError:  # nothing more
            pass
        if self._outer is not None:
            with contextlib.suppress(OSError):
                unsent(self._outer, bytes(self.to_client))
        self._close()

    def _close(self) -> None:
        for one in (self._outer, self._inner):
            if one is not None:
                self._owner.unwatch(one)
                one.close()
        self._outer = None
        self._owner.forget(self)


def unsent(to: socket.socket, data: bytes) -> bytes:
    """Send without blocking; return the rest. Raises OSError if the other side is gone."""
    if not data:
        return b""
    try:
        return data[to.send(data) :]
    except BlockingIOError:
        return data
