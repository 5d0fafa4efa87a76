"""The `record` socket: the records of a running daemon, for `hapticd record` on the same machine.

XPUB, ipc://<directory>/record. Without a subscriber nothing is encoded. A subscriber that is too slow
sees by their numbers which records it lost. A subscription to everything (`NOW`) requests the records from now on; one
to `WHOLE`, with which each record begins, a recording from a core's first input on. Where that has to wait, the
subscribers of `WAITS` get that message, followed by the directory of the simulated rig if the trackpad is simulated.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import zmq

from ...errors import HapticdError
from .gate import Gate, Listener
from .listeners import bind_inner, inner_path, local_listener
from .runtime_dir import endpoint_path
from .sockets import HANDSHAKE_MS, MAX_SUBSCRIPTION_BYTES

NAME = "record"
NOW = b""
WHOLE = b"record"
WAITS = b"waits"
SEND_HIGH_WATER = 2_000  # records, of four seconds, for a recorder that does not read; it misses the next
RECEIVE_HIGH_WATER = 20_000  # of a recorder
LINGER_MS = 200  # for the last record, when the daemon stops
MAX_READS = 64
PAUSE_S = 0.1  # between two reads of subscriptions: a recorder that attaches all the time must not hold up a pass


class RecordSocket:
    """Binds in `directory`, whose lock the caller holds, from `start` to `close`."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._context: zmq.Context[zmq.Socket[bytes]] | None = None
        self._gate: Gate | None = None
        self._subscribed: frozenset[bytes] = frozenset()

    def start(self, loop: asyncio.AbstractEventLoop, on_recorder: Callable[[bytes, bool], None]) -> None:
        """Bind, and call `on_recorder` on `loop` with `NOW` or `WHOLE`, and True where a recorder attached to it, False
        where its last one detached.

        Raises HapticdError.
        """
        self._loop, self._on_recorder = loop, on_recorder
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.linger = LINGER_MS
        self._socket.sndhwm = SEND_HIGH_WATER
        self._socket.maxmsgsize = MAX_SUBSCRIPTION_BYTES
        self._socket.handshake_ivl = HANDSHAKE_MS
        self._socket.setsockopt(zmq.XPUB_VERBOSE, 1)  # the second recorder needs a header, too
        self._gate = Gate(loop)
        path = endpoint_path(self._directory, NAME)
        try:
            bind_inner(self._socket, inner_path(path))
            self._gate.open(Listener(local_listener(path), inner_path(path)))
        except HapticdError:
            self.close()
            raise
        except (zmq.ZMQError, OSError) as error:
            self.close()
            raise HapticdError(f"{path}: recorders cannot be served here ({error.strerror}).") from None
        loop.add_reader(self._socket.FD, self._on_readable)

    def send(self, message: bytes) -> None:
        """To all recorders, without waiting."""
        self._socket.send(message, zmq.NOBLOCK)

    def sweep(self) -> None:
        """Read subscriptions; also to be called now and then, since a send may consume the socket's wake-up."""
        if self._context is None:
            return
        attached, detached, subscribed = set[bytes](), set[bytes](), set(self._subscribed)
        for _ in range(MAX_READS):
            try:
                message = self._socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            topic = message[1:]
            if topic not in (NOW, WHOLE):
                continue
            if message[:1] == b"\x01":
                subscribed.add(topic)
                attached.add(topic)
            elif message[:1] == b"\x00":
                subscribed.discard(topic)
                detached.add(topic)
        before, self._subscribed = self._subscribed, frozenset(subscribed)
        for topic in (NOW, WHOLE):
            if topic in before and topic in detached:
                self._on_recorder(topic, False)
            if topic in attached and topic in subscribed:
                self._on_recorder(topic, True)

    def _on_readable(self) -> None:
        """Read at once, and not again for PAUSE_S."""
        self.sweep()
        self._loop.remove_reader(self._socket.FD)
        self._loop.call_later(PAUSE_S, self._watch)

    def _watch(self) -> None:
        if self._context is not None:
            self.sweep()
            self._loop.add_reader(self._socket.FD, self._on_readable)

    def close(self) -> None:
        """Stop serving and remove the socket. Safe to call twice, and before `start`."""
        if self._context is None:
            return
        if not self._loop.is_closed():
            self._loop.remove_reader(self._socket.FD)
        self._socket.close()
        self._context.term()  # waits until the last records have left for the gate
        self._context = None
        if self._gate is not None:
            self._gate.close()
