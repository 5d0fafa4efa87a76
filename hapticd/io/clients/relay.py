"""Relay between one client's connection and ZeroMQ, with a bound on the bytes that the client leaves unread."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

CHUNK_BYTES = 65_536
MAX_SUBSCRIBER_BYTES = 1024  # a handshake of up to 900 bytes, its subscription, a few heartbeats
HEARTBEAT_BYTES_HZ, MAX_LOCAL_BYTES = 64.0, 16_384  # of a local subscriber: seven heartbeats a second, and all

Inbound = Callable[[bytes], bytes]  # takes what arrived, returns what to pass on; raises ProtocolError


class ProtocolError(Exception):
    """The connection must be closed."""


class SubscriberBytes:
    """Bound on a subscriber's inbound bytes: libzmq keeps each distinct subscription, and its parsing costs the daemon.

    Over TCP MAX_SUBSCRIBER_BYTES are all. A local one may send heartbeats on top, MAX_LOCAL_BYTES in all: then ZeroMQ
    reconnects it.
    """

    def __init__(self, *, is_local: bool, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._left: float = MAX_SUBSCRIBER_BYTES
        self._in_all = MAX_LOCAL_BYTES if is_local else MAX_SUBSCRIBER_BYTES
        self._clock_s = clock_s
        self._t_s = clock_s()

    def feed(self, data: bytes) -> bytes:
        """Return the bytes to pass on. Raises ProtocolError."""
        before_s, self._t_s = self._t_s, self._clock_s()
        self._left = min(self._left + (self._t_s - before_s) * HEARTBEAT_BYTES_HZ, MAX_SUBSCRIBER_BYTES) - len(data)
        self._in_all -= len(data)
        if self._left < 0.0 or self._in_all < 0:
            raise ProtocolError("more than a subscriber has to send")
        return data


class UnreadBytes(NamedTuple):
    """Most bytes that one connection and all of them may leave unread, besides the kernel's buffers."""

    connection: int
    in_all: int


class Owner(Protocol):
    """What a relay needs of the gate."""

    loop: asyncio.AbstractEventLoop
    counters: dict[str, int]

    def unwatch(self, one: socket.socket) -> None:
        """Remove a socket from the loop, which may be closed."""

    def forget(self, relay: Relay) -> None:
        """Remove a connection that is closed."""

    def leaves_too_much(self, relay: Relay, most: UnreadBytes) -> bool:
        """Return whether a connection that leaves bytes unread has to be closed."""


class Relay:
    """One client's connection and its counterpart to ZeroMQ, each read only while the other takes the bytes.

    `on_end` is called once, when the client's end of the connection is closed, whoever closed it.
    """

    def __init__(
        self,
        owner: Owner,
        number: int,
        is_local: bool,
        outer: socket.socket,
        inner: socket.socket,
        inbound: Inbound,
        most_unread: UnreadBytes | None,
        on_end: Callable[[], None],
    ) -> None:
        self.number = number
        self.is_local = is_local
        self.most_unread = most_unread
        self.to_client = bytearray()
        self.relayed_bytes = 0
        self._is_ending = False
        self._to_daemon = b""
        self._owner, self._loop = owner, owner.loop
        self._outer, self._inner = outer, inner
        self._inbound, self._on_end = inbound, on_end
        self._loop.add_reader(outer, self._from_client)
        self._loop.add_reader(inner, self._from_daemon)

    def _from_client(self) -> None:
        try:
            data = self._outer.recv(CHUNK_BYTES)
            self._to_daemon = unsent(self._inner, self._inbound(data))
        except BlockingIOError:
            return
        except ProtocolError:
            self._close("broken")
        except OSError:
            self._close()
        else:
            if not data:
                self._close()
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
            self._loop.add_reader(self._outer, self._from_client)

    def _from_daemon(self) -> None:
        was_behind = bool(self.to_client)
        try:
            data = self._inner.recv(CHUNK_BYTES)
            self.relayed_bytes += len(data)
            self.to_client += data if was_behind else unsent(self._outer, data)
        except BlockingIOError:
            return
        except OSError:
            self._close()
            return
        if not self.to_client:
            if not data:
                self._close()
        elif not data:  # ZeroMQ is done; the client still has to take what waits
            self._is_ending = True
            self._loop.remove_reader(self._inner)
            self._loop.add_writer(self._outer, self._push_to_client)
        elif self.most_unread is not None and self._owner.leaves_too_much(self, self.most_unread):
            self._close("unread")
        elif not was_behind:
            self._loop.add_writer(self._outer, self._push_to_client)
            if self.most_unread is None:
                self._loop.remove_reader(self._inner)

    def _push_to_client(self) -> None:
        try:
            del self.to_client[: self._outer.send(self.to_client[:CHUNK_BYTES])]
        except BlockingIOError:
            return
        except OSError:
            self._close()
            return
        if self.to_client:
            return
        if self._is_ending:
            self._close()
        else:
            self._loop.remove_writer(self._outer)
            self._loop.add_reader(self._inner, self._from_daemon)

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
        with contextlib.suppress(OSError):  # nothing more
            while data := self._inner.recv(CHUNK_BYTES):
                self.to_client += data
        with contextlib.suppress(OSError):
            unsent(self._outer, bytes(self.to_client))
        self._close()

    def _close(self, cause: str | None = None) -> None:
        if cause is not None:
            self._owner.counters[cause] += 1
        for one in (self._outer, self._inner):
            self._owner.unwatch(one)
            one.close()
        self._owner.forget(self)
        self._on_end()


def unsent(to: socket.socket, data: bytes) -> bytes:
    """Send without blocking; return the rest. Raises OSError if the other side is gone."""
    if not data:
        return b""
    try:
        return data[to.send(data) :]
    except BlockingIOError:
        return data
