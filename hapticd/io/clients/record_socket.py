"""The `record` socket: the records of a running daemon, for `hapticd record` on the same machine.

XPUB, ipc://<directory>/record. Each recorder has a socket of its own: a shared one may report the end of one recorder
after the begin of the next, which then would not get a whole recording. Without a subscriber nothing is encoded. A
subscriber that is too slow sees by their numbers which records it lost. A subscription to everything (`NOW`) requests
the records from now on; one to `WHOLE`, with which each record begins, a recording from a core's first input on. Where
that has to wait, the subscribers of `WAITS` get that message, followed by the directory of the simulated rig if the
trackpad is simulated.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import zmq

from ...errors import HapticdError
from .gate import Gate, Listener
from .inbox import Inbox, received
from .listeners import bind_inner, inner_path, local_listener
from .runtime_dir import endpoint_path
from .sockets import HANDSHAKE_MS, MAX_SUBSCRIPTION_BYTES

NAME = "record"
NOW = b""
WHOLE = b"record"
WAITS = b"waits"
SEND_HIGH_WATER = 2_000  # records, of four seconds, for a recorder that does not read; it misses the next
RECEIVE_HIGH_WATER = 20_000  # of a recorder
LINGER_S = 0.5  # for the last records, when the daemon stops
MAX_READS = 8  # of one recorder and sweep: one that subscribes all the time must not hold up a pass


class RecordSocket:
    """Binds in `directory`, whose lock the caller holds, from `start` to `close`."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._context: zmq.Context[zmq.Socket[bytes]] | None = None
        self._recorders: dict[Inbox, frozenset[bytes]] = {}  # and to which of NOW and WHOLE each is subscribed

    def start(self, loop: asyncio.AbstractEventLoop, on_recorder: Callable[[bytes, bool], None]) -> None:
        """Bind, and call `on_recorder` on `loop` with `NOW` or `WHOLE`, and True where a recorder attached to it, False
        where its last one detached.

        Raises HapticdError.
        """
        self._loop, self._on_recorder = loop, on_recorder
        self._context = zmq.Context()
        self._gate = Gate(loop)
        path = endpoint_path(self._directory, NAME)
        try:
            self._gate.open(Listener(local_listener(path), inner_path(path), self._attach))
        except HapticdError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise HapticdError(f"{path}: recorders cannot be served here ({error.strerror}).") from None

    def send(self, message: bytes) -> None:
        """To all recorders, without waiting."""
        frame = zmq.Frame(message, copy=True)  # one for all: recorders that do not read must not cost a copy each
        for inbox in self._recorders:
            inbox.socket.send(frame, zmq.NOBLOCK, copy=False)

    def sweep(self) -> None:
        """Read subscriptions; to be called now and then, so that recorders that attach all the time cost little."""
        attached = set[bytes]()
        for inbox, before in tuple(self._recorders.items()):
            topics = set(before)
            for _ in range(MAX_READS):
                frames = received(inbox.socket)
                if frames is None:
                    break
                message = frames[0].bytes
                if message[1:] in (NOW, WHOLE):
                    (topics.add if message[:1] == b"\x01" else topics.discard)(message[1:])
            attached |= topics - before
            self._recorders[inbox] = frozenset(topics)
            self._on_unsubscribed(before - topics)
        for topic in sorted(attached):
            self._on_recorder(topic, True)

    def _attach(self, path: Path, user: str | None) -> Inbox:
        """Bind a socket for one recorder. Raises zmq.ZMQError, HapticdError."""
        assert self._context is not None
        socket = self._context.socket(zmq.XPUB)
        socket.linger = int(LINGER_S * 1e3)
        socket.sndhwm = SEND_HIGH_WATER
        socket.maxmsgsize = MAX_SUBSCRIPTION_BYTES
        socket.handshake_ivl = HANDSHAKE_MS
        try:
            bind_inner(socket, path)
        except (zmq.ZMQError, HapticdError):
            socket.close()
            raise
        inbox = Inbox(socket, user, {}, self._loop.time, self._detach)
        self._recorders[inbox] = frozenset()
        return inbox

    def _detach(self, inbox: Inbox) -> None:
        self._on_unsubscribed(self._recorders.pop(inbox, frozenset()))

    def _on_unsubscribed(self, topics: frozenset[bytes]) -> None:
        for topic in sorted(topics):
            if not any(topic in others for others in self._recorders.values()):
                self._on_recorder(topic, False)

    def close(self) -> None:
        """Stop serving and remove the socket. Safe to call twice, and before `start`."""
        if self._context is None:
            return
        for inbox in self._recorders:
            inbox.socket.close()
        self._recorders.clear()
        self._gate.close(LINGER_S)  # first: a header fills the kernel's buffers, and ZeroMQ waits for those behind it
        self._context.term()
        self._context = None
