"""Gate in front of the ZeroMQ sockets: accepts clients' connections, bounds what they cost, and relays their bytes.

libzmq bounds messages per peer, but neither connections, nor subscriptions, nor the bytes that a peer leaves unread.
Here each user has a number of connections, each connection's inbound bytes are checked (zmtp.py), and a client that
leaves too many bytes of replies unread is disconnected. Behind the gate libzmq serves sockets that only the daemon's
user may open.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from .listeners import close_listener
from .zmtp import EncryptedInbound, Inbound, LocalInbound, ProtocolError, unchecked

MAX_CONNECTIONS, MAX_CONNECTIONS_PER_USER = 128, 64  # 16 clients of one user have 48

REFUSALS = 32  # per wake-up of a listener, or one admission; it rests afterwards, lest connecting delays the touch
REST_S = 0.01
DRAIN_EVERY_S = 0.001
STALE_S = 0.5  # after a client's end its requests are dropped: a flood of them is handled for minutes
CHUNK_BYTES = 65_536
INNER_BUFFER_BYTES = 16_384  # of requests that wait in the kernel: what a lost client left is handled to its end
CAUSES = ("crowded", "unread", "broken")  # too many connections, replies not read, not the protocol
_CREDENTIALS = struct.Struct("3i")  # struct ucred of unix(7): pid, uid, gid


class UnreadBytes(NamedTuple):
    """Most bytes that one connection, one user and all of them may leave unread, besides the kernel's buffers."""

    connection: int
    user: int
    in_all: int


UNREAD_REPLIES = UnreadBytes(2**18, 2**20, 2**22)  # the longest reply has 140 kB


@dataclass(frozen=True, slots=True)
class Door:
    """A public listener, the inner ipc path behind it, and how its connections are checked.

    `topics` are those of a publisher, None for other sockets. Beyond `most_unread` a client is disconnected; without
    that ZeroMQ drops messages at its high-water mark.
    """

    listener: socket.socket
    inner: Path
    topics: frozenset[bytes] | None = None
    most_unread: UnreadBytes | None = None


class Gate:
    """Relays between clients and ZeroMQ, from `open` to `close`. `counters` has closed connections by cause."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.counters = dict.fromkeys(CAUSES, 0)
        self.loop = loop
        self._doors: list[Door] = []
        self._relays: dict[int, _Relay] = {}  # by a number that no other connection gets
        self._connections = 0
        self._rests: dict[Door, asyncio.TimerHandle] = {}

    def open(self, door: Door) -> None:
        """Accept connections at a door."""
        self._doors.append(door)
        self.loop.add_reader(door.listener, self._accept, door)

    def close(self) -> None:
        """Pass on what ZeroMQ has sent, close all connections and remove the socket files."""
        for rest in self._rests.values():
            rest.cancel()
        for door in self._doors:
            self.unwatch(door.listener)
            close_listener(door.listener)
            door.inner.unlink(missing_ok=True)
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

    def forget(self, relay: _Relay) -> None:
        """Take note that a connection is closed."""
        del self._relays[relay.number]

    def is_stale(self, number: int) -> bool:
        """Return whether requests of a connection are dropped: its client left long ago, and ZeroMQ still has some."""
        relay = self._relays.get(number)
        return relay is not None and self.loop.time() - relay.t_lost_s > STALE_S

    def leaves_too_much(self, relay: _Relay, most: UnreadBytes) -> bool:
        """Return whether a connection that leaves bytes unread has to be closed."""
        users, in_all = 0, 0
        for one in self._relays.values():
            if one.most_unread is not None:
                in_all += len(one.to_client)
                users += len(one.to_client) if one.user == relay.user else 0
        return len(relay.to_client) > most.connection or users > most.user or in_all > most.in_all

    def _accept(self, door: Door) -> None:
        for _ in range(REFUSALS):
            try:
                outer = door.listener.accept()[0]
            except OSError:  # none is left, or no descriptor is
                break
            if self._is_admitted(door, outer):
                break
            self.counters["crowded"] += 1
            outer.close()
        self.loop.remove_reader(door.listener)
        self._rests[door] = self.loop.call_later(REST_S, self.loop.add_reader, door.listener, self._accept, door)

    def _is_admitted(self, door: Door, outer: socket.socket) -> bool:
        try:
            user, inbound = _checks(door, outer, self._connections)
        except OSError:  # it is closed already
            return False
        users = sum(relay.user == user for relay in self._relays.values())
        if users >= MAX_CONNECTIONS_PER_USER or len(self._relays) >= MAX_CONNECTIONS:
            return False
        inner = socket.socket(socket.AF_UNIX)
        inner.setblocking(False)
        inner.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, INNER_BUFFER_BYTES)
        try:
            inner.connect(str(door.inner))
        except OSError:  # libzmq is behind with accepting
            inner.close()
            return False
        self._relays[self._connections] = _Relay(self, self._connections, user, outer, inner, inbound, door.most_unread)
        self._connections += 1
        return True


class _Relay:
    """One client's connection and its counterpart to ZeroMQ, each read only while the other takes the bytes.

    libzmq goes on to answer the requests that a lost client has left, and frees the answers only when they are read. So
    that counterpart is read to its end.
    """

    def __init__(
        self,
        gate: Gate,
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
        self._gate, self._loop = gate, gate.loop
        self._outer: socket.socket | None = outer
        self._inner = inner
        self._inbound = inbound
        self._loop.add_reader(outer, self._from_client)
        self._loop.add_reader(inner, self._from_daemon)

    def _from_client(self) -> None:
        assert self._outer is not None
        try:
            data = self._outer.recv(CHUNK_BYTES)
            self._to_daemon = _unsent(self._inner, self._inbound(data))
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
            self._to_daemon = _unsent(self._inner, self._to_daemon)
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
        elif self.most_unread is not None and self._gate.leaves_too_much(self, self.most_unread):
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
            self.to_client += data if self.to_client else _unsent(self._outer, data)
        except OSError:
            self._lose()

    def _lose(self, cause: str | None = None) -> None:
        """Close the client's side, and read the other to its end."""
        if cause is not None:
            self._gate.counters[cause] += 1
        self.to_client.clear()
        if self._outer is None:
            return
        self._gate.unwatch(self._outer)
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
                _unsent(self._outer, bytes(self.to_client))
        self._close()

    def _close(self) -> None:
        for one in (self._outer, self._inner):
            if one is not None:
                self._gate.unwatch(one)
                one.close()
        self._outer = None
        self._gate.forget(self)


def _unsent(to: socket.socket, data: bytes) -> bytes:
    """Send without blocking; return the rest. Raises OSError if the other side is gone."""
    if not data:
        return b""
    try:
        return data[to.send(data) :]
    except BlockingIOError:
        return data


def _checks(door: Door, outer: socket.socket, number: int) -> tuple[str, Inbound]:
    """Return the user of a connection, as far as it is known before the handshake, and the check of its bytes."""
    outer.setblocking(False)
    if outer.family == socket.AF_UNIX:
        found = outer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        pid, uid, _ = _CREDENTIALS.unpack(found)
        return f"uid {uid}", LocalInbound(f"{uid}:{pid}:{number}", door.topics).feed
    outer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return f"address {outer.getpeername()[0]}", unchecked if door.topics is None else EncryptedInbound().feed
