"""The `record` socket: what recorders of a running daemon connect to, on this machine only.

XPUB, ipc://<directory>/record. While nobody subscribes nothing is framed. A recorder that does not keep up loses
records, and sees by their numbers which. A subscription to everything (b"") asks for records from now on; one to
`WHOLE`, with which each record begins, for a recording from a core's first moment on, which may have to be waited for:
then the subscribers of `WAITS` hear it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import zmq

from ...errors import HapticdError
from .runtime_dir import endpoint_path, masked
from .sockets import MAX_SUBSCRIPTION_BYTES, SOCKET_UMASK

NAME = "record"
NOW = b""
WHOLE = b"\xa5rec"
WAITS = b"waits"
SEND_HIGH_WATER = 20_000  # records for a slow recorder, half a minute of touching
LINGER_MS = 200  # for the last record, when the daemon stops
MAX_READS = 64
REST_S = 0.1  # between two looks at who comes and goes: somebody who does so all the time must not hold up a pass


class RecordSocket:
    """Binds in `directory`, whose lock the caller holds, from `start` to `close`."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / NAME
        self._directory = directory
        self._context: zmq.Context[zmq.Socket[bytes]] | None = None
        self._there: frozenset[bytes] = frozenset()

    def start(self, loop: asyncio.AbstractEventLoop, on_recorder: Callable[[bytes, bool], None]) -> None:
        """Bind, and call `on_recorder` on `loop` with `NOW` or `WHOLE`, and True where recorders came to it, False when
        its last one went.

        Raises HapticdError.
        """
        self._loop, self._on_recorder = loop, on_recorder
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.linger = LINGER_MS
        self._socket.sndhwm = SEND_HIGH_WATER
        self._socket.maxmsgsize = MAX_SUBSCRIPTION_BYTES
        self._socket.setsockopt(zmq.XPUB_VERBOSE, 1)  # the second recorder needs a header, too
        try:
            with masked(SOCKET_UMASK):
                self._socket.bind(f"ipc://{endpoint_path(self._directory, NAME)}")
        except zmq.ZMQError as error:
            self.close()
            raise HapticdError(f"{self._path}: recorders cannot be served here ({error.strerror}).") from None
        loop.add_reader(self._socket.FD, self._hear)

    def send(self, record: bytes) -> None:
        """To all recorders, without waiting."""
        self._socket.send(record, zmq.NOBLOCK)

    def sweep(self) -> None:
        """Read who came and went; also to be called now and then, for a send may eat a socket's wake-up."""
        if self._context is None:
            return
        came, left, there = set[bytes](), set[bytes](), set(self._there)
        for _ in range(MAX_READS):
            try:
                said = self._socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            if said[1:] not in (NOW, WHOLE):
                continue
            if said[:1] == b"\x01":
                there.add(said[1:])
                came.add(said[1:])
            elif said[:1] == b"\x00":
                there.discard(said[1:])
                left.add(said[1:])
        before, self._there = self._there, frozenset(there)
        for wanted in (NOW, WHOLE):
            if wanted in before and wanted in left:
                self._on_recorder(wanted, False)
            if wanted in came and wanted in there:
                self._on_recorder(wanted, True)

    def _hear(self) -> None:
        """Look at once, and not again for a while."""
        self.sweep()
        self._loop.remove_reader(self._socket.FD)
        self._loop.call_later(REST_S, self._listen)

    def _listen(self) -> None:
        if self._context is not None:
            self.sweep()
            self._loop.add_reader(self._socket.FD, self._hear)

    def close(self) -> None:
        """Stop serving and remove the socket. Safe to call twice, and before `start`."""
        if self._context is None:
            return
        if not self._loop.is_closed():
            self._loop.remove_reader(self._socket.FD)
        self._socket.close()
        self._context.term()
        self._context = None
        self._path.unlink(missing_ok=True)
