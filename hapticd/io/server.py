"""The sockets that clients connect to: ZeroMQ over ipc, on the daemon's own event loop.

    targets    PULL    one-part messages in; each replaces what its client wanted before
    control    ROUTER  requests in, replies out
    telemetry  XPUB    states out, and knowledge of whether anybody listens

A ZeroMQ file descriptor is edge-triggered, and any call on the socket may eat the edge: every wake-up reads to the
end, and `sweep`, called on the daemon's tick, catches what an eaten edge left behind. zmq.asyncio is not used: it
receives five times slower, and its tail is a tick long under load.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import zmq

from ..errors import AlreadyRunningError, HapticdError
from .runtime_dir import endpoint_path, own_directory, runtime_directory

__all__ = ["ClientServer", "runtime_directory"]

ENDPOINTS = ("targets", "control", "telemetry")  # socket files in the runtime directory

MAX_MESSAGE_BYTES = 65536  # a larger one costs its sender the connection
RECEIVE_HIGH_WATER = 32  # messages per client; what a flood has beyond waits in the client's own buffers
SEND_HIGH_WATER = 16
MAX_READS = 64  # per socket and wake-up, so that a flood cannot hold the tick
BREATH_S = 0.005  # between wake-ups under a flood
SOCKET_UMASK = 0o117  # owner and group may connect, others may not
MAX_PARTS = 3  # of a request: identity, an empty delimiter from REQ clients, payload

Context = zmq.Context[zmq.Socket[bytes]]
Socket = zmq.Socket[bytes]


@dataclass(frozen=True, slots=True)
class _Sockets:
    context: Context
    targets: Socket
    control: Socket
    telemetry: Socket

    @property
    def all(self) -> tuple[Socket, Socket, Socket]:
        return self.targets, self.control, self.telemetry

    def close(self) -> None:
        for socket in self.all:
            socket.close()
        self.context.term()


@dataclass(frozen=True, slots=True)
class _Service:
    """What there is between `start` and `close`."""

    loop: asyncio.AbstractEventLoop
    sockets: _Sockets
    on_message: Callable[[bytes], None]
    on_request: Callable[[bytes], bytes]


class ClientServer:
    """Serves clients in `runtime_dir` from `start` to `close`. `dropped` counts messages of a wrong number of parts."""

    def __init__(self, runtime_dir: Path) -> None:
        self.dropped = 0
        self._directory = runtime_dir
        self._lock_fd: int | None = None
        self._service: _Service | None = None
        self._breath: asyncio.TimerHandle | None = None
        self._is_subscribed = False

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_message: Callable[[bytes], None],
        on_request: Callable[[bytes], bytes],
    ) -> None:
        """Lock the directory, bind, and serve on `loop`. Raises AlreadyRunningError, or HapticdError for the directory.

        `on_message` gets each payload of `targets`, `on_request` answers each payload of `control`; both are called
        on the loop and must not raise.
        """
        own_directory(self._directory)
        paths = [endpoint_path(self._directory, name) for name in ENDPOINTS]
        self._lock_fd = _locked(self._directory / "lock")
        try:
            sockets = _bound(paths)
        except zmq.ZMQError as error:
            self.close()
            raise HapticdError(f"{self._directory}: clients cannot be served here ({error.strerror}).") from None
        self._service = _Service(loop, sockets, on_message, on_request)
        for socket in sockets.all:
            loop.add_reader(socket.FD, self.sweep)
        self.sweep()  # an edge before add_reader would never be seen

    @property
    def has_subscribers(self) -> bool:
        """Somebody reads telemetry: only then is it worth building."""
        return self._is_subscribed

    def publish(self, payload: bytes) -> None:
        """Send a state to all subscribers; dropped for those that do not keep up."""
        if self._service is None or not self._is_subscribed:
            return
        self._service.sockets.telemetry.send(payload, zmq.NOBLOCK)
        self._read_subscriptions(self._service)  # the send may have eaten the edge of a subscription

    def sweep(self) -> None:
        """Read all sockets to the end, or up to MAX_READS each; never waits."""
        service = self._service
        if service is None:
            return
        flooded = self._read_targets(service)
        flooded |= self._read_requests(service)
        flooded |= self._read_subscriptions(service)
        if flooded and self._breath is None:  # no edge will come for what is still there
            self._breath = service.loop.call_later(BREATH_S, self._resume)

    def close(self) -> None:
        """Stop serving, remove the sockets, then give up the lock. Safe to call twice, and after a failed start."""
        if self._breath is not None:
            self._breath.cancel()
            self._breath = None
        if self._service is not None:
            for socket in self._service.sockets.all:
                self._service.loop.remove_reader(socket.FD)
            self._service.sockets.close()
            self._service = None
            for name in ENDPOINTS:  # ZeroMQ leaves its files; while the lock is held they are ours
                (self._directory / name).unlink(missing_ok=True)
        self._is_subscribed = False
        if self._lock_fd is not None:
            os.close(self._lock_fd)
            self._lock_fd = None

    def _resume(self) -> None:
        self._breath = None
        self.sweep()

    # --- each returns True where more may be waiting ---

    def _read_targets(self, service: _Service) -> bool:
        for _ in range(MAX_READS):
            parts = _received(service.sockets.targets)
            if parts is None:
                return False
            if len(parts) == 1:
                service.on_message(parts[0])
            else:
                self.dropped += 1
        return True

    def _read_requests(self, service: _Service) -> bool:
        socket = service.sockets.control
        for _ in range(MAX_READS):
            parts = _received(socket)
            if parts is None:
                return False
            if len(parts) == 2 or (len(parts) == 3 and parts[1] == b""):
                socket.send_multipart([*parts[:-1], service.on_request(parts[-1])], zmq.NOBLOCK)
            else:
                self.dropped += 1
        return True

    def _read_subscriptions(self, service: _Service) -> bool:
        """Only the subscription to everything counts: ZeroMQ reports its first and last holder, vanished ones too."""
        for _ in range(MAX_READS):
            parts = _received(service.sockets.telemetry)
            if parts is None:
                return False
            if parts[0] in (b"\x00", b"\x01"):
                self._is_subscribed = parts[0] == b"\x01"
        return True


def _bound(paths: Sequence[Path]) -> _Sockets:
    """Sockets bound to the paths of ENDPOINTS. Raises zmq.ZMQError, with nothing left open."""
    context = zmq.Context()
    sockets = _Sockets(context, context.socket(zmq.PULL), context.socket(zmq.ROUTER), context.socket(zmq.XPUB))
    try:
        with _umask(SOCKET_UMASK):
            for socket, path in zip(sockets.all, paths, strict=True):
                socket.linger = 0
                socket.rcvhwm = RECEIVE_HIGH_WATER
                socket.sndhwm = SEND_HIGH_WATER
                socket.maxmsgsize = MAX_MESSAGE_BYTES
                socket.bind(f"ipc://{path}")
    except zmq.ZMQError:
        sockets.close()
        raise
    return sockets


def _received(socket: Socket) -> list[bytes] | None:
    """The parts of the next message, without waiting; those beyond what any client should send are thrown away."""
    try:
        parts = [socket.recv(zmq.NOBLOCK)]
    except zmq.Again:
        return None
    while socket.rcvmore:
        part = socket.recv()
        if len(parts) <= MAX_PARTS:
            parts.append(part)
    return parts


def _locked(path: Path) -> int:
    """The lock file, held until closed. It comes first: binding would steal a running daemon's sockets in silence."""
    try:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise HapticdError(f"{path}: cannot be opened ({error.strerror}): check who owns it.") from None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise AlreadyRunningError(
            f"Another hapticd serves {path.parent}: stop it, or set HAPTICD_RUNTIME_DIR to another directory."
        ) from None
    return fd


@contextmanager
def _umask(mask: int) -> Iterator[None]:
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)
