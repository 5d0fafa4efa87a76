"""Gate in front of the ZeroMQ sockets: accepts clients' connections, bounds what they cost, and relays their bytes.

libzmq bounds messages per peer, but neither connections, nor subscriptions, nor the bytes that a peer leaves unread.
Here each user has a number and a rate of connections, each connection's inbound bytes are checked (zmtp.py), and a
client that leaves too many bytes of replies unread is disconnected. Behind the gate libzmq serves sockets that only the
daemon's user may open: one for all subscribers, and one for each connection that sends messages, so that none of them
is handled after its connection has ended.

Accepting is cheap and admitting is not, so they are two steps. A wake-up accepts many connections and drops those that
are closed again or too fast, so that a flood does not fill the kernel's queue, in which users have no turns. What is
left waits, and is admitted one at a time, of each user in turn.
"""

from __future__ import annotations

import asyncio
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import zmq

from ...errors import HapticdError
from .listeners import close_listener
from .relay import Relay, UnreadBytes
from .senders import RateLimiter, Sender, local_sender
from .zmtp import LocalInbound, SubscriberInbound

MAX_CONNECTIONS, MAX_CONNECTIONS_PER_USER = 128, 64  # 16 clients of one user have 48
CONNECTIONS_HZ = 50.0  # of one user, after MAX_CONNECTIONS at once

ACCEPTS = 16  # per wake-up of a listener: some 0.3 ms, lest connecting delays the touch
REST_S = 0.001  # after a wake-up that found as many, at least
ADMIT_EVERY_S = 0.003
# Most descriptors of a gate: an admitted connection has one to the client, one to libzmq, and three of libzmq's own.
MAX_DESCRIPTORS = 5 * MAX_CONNECTIONS + ACCEPTS
DRAIN_EVERY_S = 0.001
# Closed before they were accepted, by users that connect too fast, too many, replies not read, not the protocol
CAUSES = ("gone_early", "connected_too_fast", "crowded", "unread", "broken")
UNREAD_REPLIES = UnreadBytes(2**18, 2**20, 2**22)  # the longest reply has 140 kB
_CREDENTIALS = struct.Struct("3i")  # struct ucred of unix(7): pid, uid, gid


class Receiver(Protocol):
    """What is behind one connection: a check of its bytes, and its end."""

    def feed(self, data: bytes) -> bytes:
        """Return the bytes to pass on. Raises ProtocolError."""

    def close(self) -> None:
        """End, with all that is not handled."""


@dataclass(frozen=True, slots=True)
class Door:
    """A public listener, and what is behind it.

    That is the inner ipc path of a publisher and its `topics`; or `inbox`, which binds a socket for one connection to
    an inner path, given its sender on this machine. Beyond `most_unread` a client is disconnected; without that ZeroMQ
    drops messages at its high-water mark.
    """

    listener: socket.socket
    inner: Path
    topics: frozenset[bytes] = frozenset()
    most_unread: UnreadBytes | None = None
    inbox: Callable[[Path, Sender | None], Receiver] | None = None


class Gate:
    """Relays between clients and ZeroMQ, from `open` to `close`. `counters` has closed connections by cause."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.counters = dict.fromkeys(CAUSES, 0)
        self.loop = loop
        self._doors: list[Door] = []
        self._waiting: dict[str, deque[tuple[Door, socket.socket]]] = {}  # to be admitted, by user; the next one first
        self._rates = RateLimiter(CONNECTIONS_HZ, MAX_CONNECTIONS)
        self._relays: dict[int, Relay] = {}  # by a number that no other connection gets
        self._connections = 0
        self._rests: dict[Door, asyncio.TimerHandle] = {}
        self._admission: asyncio.TimerHandle | None = None

    def open(self, door: Door) -> None:
        """Accept connections at a door."""
        self._doors.append(door)
        self.loop.add_reader(door.listener, self._accept, door)

    def close(self) -> None:
        """Pass on what ZeroMQ has sent, close all connections and remove the socket files."""
        for rest in self._rests.values():
            rest.cancel()
        if self._admission is not None:
            self._admission.cancel()
        for door in self._doors:
            self.unwatch(door.listener)
            close_listener(door.listener)
            door.inner.unlink(missing_ok=True)
        for waiting in self._waiting.values():
            for _, outer in waiting:
                outer.close()
        self._waiting.clear()
        for relay in tuple(self._relays.values()):
            relay.finish()

    def drain(self, is_over: Callable[[], bool], within_s: float) -> None:
        """Relay to the clients while the loop does not run, until ZeroMQ has sent all of it and they have it."""
        t_end_s = time.monotonic() + within_s
        while time.monotonic() < t_end_s:
            was_over = is_over()
            relays = tuple(self._relays.values())
            if sum(relay.pump() for relay in relays) == 0 and was_over:
                return
            time.sleep(DRAIN_EVERY_S)

    def unwatch(self, one: socket.socket) -> None:
        """Remove a socket from the loop, which may be closed."""
        if not self.loop.is_closed():
            self.loop.remove_reader(one)
            self.loop.remove_writer(one)

    def forget(self, relay: Relay) -> None:
        """Take note that a connection is closed."""
        del self._relays[relay.number]

    def leaves_too_much(self, relay: Relay, most: UnreadBytes) -> bool:
        """Return whether a connection that leaves bytes unread has to be closed."""
        users, in_all = 0, 0
        for one in self._relays.values():
            if one.most_unread is not None:
                in_all += len(one.to_client)
                users += len(one.to_client) if one.user == relay.user else 0
        return len(relay.to_client) > most.connection or users > most.user or in_all > most.in_all

    def _accept(self, door: Door) -> None:
        """Accept at most ACCEPTS connections; those that may stay wait to be admitted."""
        accepted = []
        for _ in range(ACCEPTS):
            try:
                accepted.append(door.listener.accept()[0])
            except OSError:  # none is left
                break
        gone = _gone(accepted)
        for outer in accepted:
            user = None if outer.fileno() in gone else _user(outer)
            cause = "gone_early" if user is None else self._refusal(user)
            if user is None or cause:
                self._refuse(outer, cause)
            else:
                self._waiting.setdefault(user, deque()).append((door, outer))
        if self._admission is None:
            self._admit()
        self.loop.remove_reader(door.listener)
        self._rests[door] = self.loop.call_later(REST_S, self.loop.add_reader, door.listener, self._accept, door)

    def _refusal(self, user: str) -> str:
        """Return the cause for which a user's connection is refused, "" if it may wait to be admitted."""
        if not self._rates.admit(user, self.loop.time()):
            return "connected_too_fast"
        users = len(self._waiting.get(user, ())) + sum(relay.user == user for relay in self._relays.values())
        in_all = len(self._relays) + sum(map(len, self._waiting.values()))
        return "crowded" if users >= MAX_CONNECTIONS_PER_USER or in_all >= MAX_CONNECTIONS else ""

    def _refuse(self, outer: socket.socket, cause: str) -> None:
        self.counters[cause] += 1
        outer.close()

    def _admit(self) -> None:
        """Relay the next connection that waits, of each user in turn, and go on after ADMIT_EVERY_S."""
        self._admission = None
        while self._waiting and self._admission is None:
            user = next(iter(self._waiting))
            waiting = self._waiting.pop(user)
            door, outer = waiting.popleft()
            if waiting:
                self._waiting[user] = waiting  # behind the other users
            if _gone([outer]):
                self._refuse(outer, "gone_early")
                continue
            self._relay(door, outer, user)
            self._admission = self.loop.call_later(ADMIT_EVERY_S, self._admit)

    def _relay(self, door: Door, outer: socket.socket, user: str) -> None:
        number = self._connections
        inner, inbox = socket.socket(socket.AF_UNIX), None
        try:
            inner.setblocking(False)
            outer.setblocking(False)
            if not _is_local(outer):
                outer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if door.inbox is None:
                inner.connect(str(door.inner))
                feed = LocalInbound(door.topics).feed if _is_local(outer) else SubscriberInbound().feed
            else:
                path = door.inner.with_name(f".{number % 10**6}")  # not longer than that of a public socket
                inbox = door.inbox(path, _local_sender(outer))
                feed = inbox.feed
                inner.connect(str(path))
                path.unlink()
        except (OSError, zmq.ZMQError, HapticdError):  # libzmq is behind with accepting, or the client is gone
            inner.close()
            if inbox is not None:
                inbox.close()
            self._refuse(outer, "crowded")
            return
        on_end = _nothing if inbox is None else inbox.close
        self._relays[number] = Relay(self, number, user, outer, inner, feed, door.most_unread, on_end)
        self._connections += 1


def _nothing() -> None:
    """End of a connection behind which nothing is its own."""


def _gone(connections: Sequence[socket.socket]) -> set[int]:
    """Return the descriptors of those whose peer has closed: without the daemon's greeting it sent no message."""
    poll = select.poll()
    for one in connections:
        poll.register(one, select.POLLRDHUP)
    return {fd for fd, _ in poll.poll(0)}


def _user(outer: socket.socket) -> str | None:
    """Return the user of a connection, as far as it is known before the handshake; None if it is closed."""
    try:
        return f"uid {_credentials(outer)[1]}" if _is_local(outer) else f"address {outer.getpeername()[0]}"
    except OSError:
        return None


def _local_sender(outer: socket.socket) -> Sender | None:
    """Return the sender of a local connection, None for one over TCP. Raises OSError."""
    return local_sender(*_credentials(outer)[:2]) if _is_local(outer) else None


def _is_local(outer: socket.socket) -> bool:
    return outer.family == socket.AF_UNIX


def _credentials(outer: socket.socket) -> tuple[int, int, int]:
    found = outer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, gid = _CREDENTIALS.unpack(found)
    return pid, uid, gid
