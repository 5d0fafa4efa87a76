"""Gate in front of the ZeroMQ sockets: accepts clients' connections, bounds what they cost, and relays their bytes.

libzmq bounds messages per peer, but neither connections nor subscriptions. Here the connections have a number and a
rate, and a subscriber's inbound bytes are bounded. Behind the gate libzmq serves sockets that only the daemon's user
may open: one for all subscribers of states, and one for each other connection, so that nothing of it is handled after
its end.

Accepting is cheap and admitting is not, so they are two steps. A wake-up accepts many connections and drops those that
are closed again, so that a flood does not fill the kernel's queue. What is left waits, and is admitted one at a time.
"""

from __future__ import annotations

import asyncio
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import zmq

from ...errors import HapticdError
from .inbox import Inbox
from .listeners import close_listener
from .relay import Inbound, Relay

MAX_CONNECTIONS = 64  # of this computer's clients, and as many over TCP; 16 clients have 48
# Of a subscriber, over TCP and on this computer: libzmq keeps each distinct subscription, and its parsing costs the
# daemon. A handshake has up to 900; with heartbeats a local one is reconnected after half an hour.
MAX_SUBSCRIBER_BYTES, MAX_LOCAL_BYTES = 1024, 16_384

ACCEPTS = 16  # per wake-up of a listener: some 0.3 ms, lest connecting delays the touch
PAUSE_S = 0.001  # after a wake-up that found as many, at least
ADMIT_EVERY_S = 0.01  # 100 a second, each with sockets of its own
# Most descriptors of a gate: an admitted connection has one to the client, one to libzmq, and three of libzmq's own.
MAX_DESCRIPTORS = 5 * 2 * MAX_CONNECTIONS + ACCEPTS
CAUSES = ("gone_early", "crowded", "broken")  # closed before it was admitted, too many, more bytes than a subscriber's
_CREDENTIALS = struct.Struct("3i")  # struct ucred of unix(7): pid, uid, gid


class Listener(NamedTuple):
    """A public socket that listens, and what is behind it.

    That is the inner ipc path of a publisher; or `inbox`, which binds a socket for one connection to an inner path,
    given its user on this machine.
    """

    socket: socket.socket
    inner: Path
    inbox: Callable[[Path, str | None], Inbox] | None = None


class Gate:
    """Relays between clients and ZeroMQ, from `open` to `close`. `counters` has closed connections by cause."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.counters = dict.fromkeys(CAUSES, 0)
        self._loop = loop
        self._listeners: list[Listener] = []
        self._waiting: deque[tuple[Listener, socket.socket]] = deque()  # to be admitted
        self._relays: set[Relay] = set()
        self._connections = 0
        self._pauses: dict[Listener, asyncio.TimerHandle] = {}
        self._admission: asyncio.TimerHandle | None = None

    def open(self, listener: Listener) -> None:
        """Accept connections of a listener."""
        self._listeners.append(listener)
        self._loop.add_reader(listener.socket, self._accept, listener)

    def close(self, linger_s: float = 0.0) -> None:
        """Close all connections and remove the socket files; ZeroMQ's last messages are passed on for `linger_s`."""
        t_end_s = time.monotonic() + linger_s
        for timer in (*self._pauses.values(), *([] if self._admission is None else [self._admission])):
            timer.cancel()
        for listener in self._listeners:
            if not self._loop.is_closed():
                self._loop.remove_reader(listener.socket)
            close_listener(listener.socket)
            listener.inner.unlink(missing_ok=True)
        while self._waiting:
            self._waiting.popleft()[1].close()
        for relay in tuple(self._relays):
            relay.finish(t_end_s)

    def _accept(self, listener: Listener) -> None:
        """Accept at most ACCEPTS connections; those that may stay wait to be admitted."""
        accepted = []
        for _ in range(ACCEPTS):
            try:
                accepted.append(listener.socket.accept()[0])
            except OSError:  # none is left
                break
        gone, is_local = _gone(accepted), _is_local(listener.socket)
        for outer in accepted:
            present = [_is_local(one) for _, one in self._waiting] + [one.is_local for one in self._relays]
            if outer.fileno() in gone:
                self._refuse(outer, "gone_early")
            elif present.count(is_local) >= MAX_CONNECTIONS:
                self._refuse(outer, "crowded")
            else:
                self._waiting.append((listener, outer))
        if self._admission is None:
            self._admit()
        self._loop.remove_reader(listener.socket)
        self._pauses[listener] = self._loop.call_later(
            PAUSE_S, self._loop.add_reader, listener.socket, self._accept, listener
        )

    def _refuse(self, outer: socket.socket, cause: str) -> None:
        self.counters[cause] += 1
        outer.close()

    def _admit(self) -> None:
        """Relay the next connection that waits, and go on after ADMIT_EVERY_S."""
        self._admission = None
        while self._waiting:
            listener, outer = self._waiting.popleft()
            if _gone([outer]):
                self._refuse(outer, "gone_early")
                continue
            self._relay(listener, outer)
            self._admission = self._loop.call_later(ADMIT_EVERY_S, self._admit)
            return

    def _relay(self, listener: Listener, outer: socket.socket) -> None:
        is_local = _is_local(outer)
        inner, inbox, path = socket.socket(socket.AF_UNIX), None, listener.inner
        try:
            inner.setblocking(False)
            outer.setblocking(False)
            if not is_local:
                outer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if listener.inbox is not None:
                path = path.with_name(f".{self._connections % 10**6}")  # not longer than that of a public socket
                inbox = listener.inbox(path, _user(outer) if is_local else None)
            inner.connect(str(path))
        except (OSError, zmq.ZMQError, HapticdError):  # libzmq is behind with accepting, or the client is gone
            inner.close()
            if inbox is not None:
                inbox.close()
            self._refuse(outer, "crowded")
            return
        if inbox is not None:
            path.unlink()
        if inbox is None or inbox.socket.type == zmq.XPUB:
            inbound = self._bounded(MAX_LOCAL_BYTES if is_local else MAX_SUBSCRIBER_BYTES)
        else:
            inbound = inbox.note_arrival

        def on_close(relay: Relay) -> None:
            self._relays.discard(relay)
            if inbox is not None:
                inbox.close()

        relay = Relay(self._loop, outer, inner, inbound, on_close)
        if inbox is not None:
            inbox.relay = relay
        self._relays.add(relay)
        self._connections += 1

    def _bounded(self, left: int) -> Inbound:
        """Return what ends a connection after so many bytes."""

        def take(count: int) -> bool:
            nonlocal left
            left -= count
            self.counters["broken"] += left < 0
            return left >= 0

        return take


def _gone(connections: Sequence[socket.socket]) -> set[int]:
    """Return the descriptors of those whose peer has closed: without the daemon's greeting it sent no message."""
    poll = select.poll()
    for one in connections:
        poll.register(one, select.POLLRDHUP)
    return {fd for fd, _ in poll.poll(0)}


def _is_local(outer: socket.socket) -> bool:
    return outer.family == socket.AF_UNIX


def _user(outer: socket.socket) -> str:
    """Return the user of a local connection, by the kernel. Raises OSError."""
    _, uid, _ = _CREDENTIALS.unpack(outer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return f"uid {uid}"
