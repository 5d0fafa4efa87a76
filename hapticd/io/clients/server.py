"""What clients connect to: ZeroMQ over ipc, and over TCP for those with a key, on the daemon's own event loop.

    targets    PULL    one-part messages in; each replaces what its client wanted before
    control    ROUTER  requests in, replies out
    telemetry  XPUB    states out, and knowledge of whether anybody listens

A ZeroMQ file descriptor is edge-triggered, and any call on the socket may eat the edge: every wake-up, and every send,
reads to the end, and `sweep`, which the daemon calls now and then, catches what an eaten edge left behind all the same.
zmq.asyncio carries no message of a client's: it receives five times slower, and its tail is a tick long under load.

A flood cannot hold the loop: a wake-up reads for BUDGET_S of each socket, then the loop breathes, and each sender has
a rate (senders.py). What is lost by that is counted and said.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import zmq

from ...errors import HapticdError
from .runtime_dir import endpoint_path, locked, own_directory, runtime_directory
from .senders import RateLimiter, Sender, sender_of
from .sockets import ENDPOINTS, MAX_MESSAGE_BYTES, AllowList, Remote, Socket, Sockets, bound

__all__ = ["MAX_MESSAGE_BYTES", "ClientServer", "runtime_directory"]

log = logging.getLogger("hapticd")

MAX_READS = 64  # per socket and wake-up, so that a flood cannot hold the tick
BUDGET_S = 0.0005  # the same in time, for messages that take long to read
BREATH_S = 0.005  # between wake-ups under a flood
MAX_PARTS = 3  # of a request: identity, an empty delimiter from REQ clients, payload
REQUESTS_WAITING = 8  # of one sender beyond its rate; of `targets` only the newest matters
SAY_EVERY_S = 10.0  # losses are said at most so often

Parts = list[bytes]
Letter = tuple[Sender, Parts]


@dataclass(frozen=True, slots=True)
class _Service:
    """What there is between `start` and `close`."""

    loop: asyncio.AbstractEventLoop
    sockets: Sockets
    on_message: Callable[[bytes, str], None]
    on_request: Callable[[bytes, str], bytes]
    on_listener: Callable[[], None]


class ClientServer:
    """Serves clients in `runtime_dir` from `start` to `close`, and over TCP those whose keys `remote` allows."""

    def __init__(self, runtime_dir: Path, remote: Remote | None = None) -> None:
        self.misshapen = 0  # messages of a wrong number of parts
        self._directory = runtime_dir
        self._remote = remote
        self._allow_list = None if remote is None else AllowList(remote)
        self._key_names = {} if remote is None else remote.keys.clients
        self._lock_fd: int | None = None
        self._service: _Service | None = None
        self._breath: asyncio.TimerHandle | None = None
        self._is_subscribed = False
        self._messages: RateLimiter[Letter] = RateLimiter(patience=1)
        self._requests: RateLimiter[Letter] = RateLimiter(patience=REQUESTS_WAITING)
        self._lost_said = 0
        self._t_said_s: float | None = None

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_message: Callable[[bytes, str], None],
        on_request: Callable[[bytes, str], bytes],
        on_listener: Callable[[], None] = lambda: None,
    ) -> None:
        """Lock the directory, bind, and serve on `loop`. Raises AlreadyRunningError, or HapticdError for the directory.

        `on_message` gets each payload of `targets` and who answers for it, `on_request` answers each payload of
        `control`; `on_listener` hears when somebody begins to read telemetry, where nobody did. All are called on the
        loop and must not raise. With `remote`, call it on the running loop.
        """
        own_directory(self._directory)
        paths = [endpoint_path(self._directory, name) for name in ENDPOINTS]
        self._lock_fd = locked(self._directory / "lock")
        try:
            sockets = bound(paths, self._remote, self._allow_list)
        except zmq.ZMQError as error:
            self.close()
            where = self._directory if self._remote is None else f"{self._directory}, TCP port {self._remote.port}"
            raise HapticdError(f"{where}: clients cannot be served here ({error.strerror}).") from None
        self._service = _Service(loop, sockets, on_message, on_request, on_listener)
        for socket in sockets.all:
            loop.add_reader(socket.FD, self._on_edge)
        self.sweep()  # an edge before add_reader would never be seen

    @property
    def counters(self) -> dict[str, int]:
        """What never reached anybody, by why: too fast, of a wrong shape, without an allowed key."""
        return {
            "too_fast": self._messages.lost + self._requests.lost,
            "misshapen": self.misshapen,
            "denied": 0 if self._allow_list is None else self._allow_list.denied,
        }

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
        """Read all sockets to the end, or for their share of time; never waits."""
        service = self._service
        if service is None:
            return
        more = self._read_targets(service)
        more |= self._read_requests(service)
        had_listener = self._is_subscribed
        more |= self._read_subscriptions(service)
        if self._is_subscribed and not had_listener:
            service.on_listener()
        if more and self._breath is None:  # no edge will come for what is still there
            self._breath = service.loop.call_later(BREATH_S, self._resume)
        self._say_losses(service.loop.time())

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

    def _on_edge(self) -> None:
        if self._breath is None or self._service is None:
            self.sweep()
            return
        for socket in self._service.sockets.all:  # asked for its events a socket is silent, and the breath is kept
            socket.get(zmq.EVENTS)

    def _resume(self) -> None:
        self._breath = None
        self.sweep()

    # --- each returns True where more may be waiting ---

    def _read_targets(self, service: _Service) -> bool:
        def handle(sender: Sender, parts: Parts) -> None:
            service.on_message(parts[0], sender.user)

        return self._read(service.loop, service.sockets.targets, self._messages, (1,), handle)

    def _read_requests(self, service: _Service) -> bool:
        socket = service.sockets.control

        def handle(sender: Sender, parts: Parts) -> None:
            socket.send_multipart([*parts[:-1], service.on_request(parts[-1], sender.user)], zmq.NOBLOCK)

        return self._read(service.loop, socket, self._requests, (2, 3), handle)

    def _read(
        self,
        loop: asyncio.AbstractEventLoop,
        socket: Socket,
        rate_limiter: RateLimiter[Letter],
        shapes: tuple[int, ...],
        handle: Callable[[Sender, Parts], None],
    ) -> bool:
        """Handle what waits and may be; `shapes` are the numbers of parts that a message may have."""
        t_s = loop.time()
        t_end_s = t_s + BUDGET_S
        for sender, parts in rate_limiter.due(t_s):
            handle(sender, parts)
            if loop.time() >= t_end_s:
                return True
        for _ in range(MAX_READS):
            frames = _received(socket)
            if frames is None:
                return rate_limiter.is_waiting
            if not _has_shape(frames, shapes):
                self.misshapen += 1
                continue
            letter = sender_of(frames[-1], self._key_names), [frame.bytes for frame in frames]
            if rate_limiter.admit(letter[0].source, letter, t_s):
                handle(*letter)
            if loop.time() >= t_end_s:
                return True
        return True

    def _read_subscriptions(self, service: _Service) -> bool:
        """Only the subscription to everything counts: ZeroMQ reports its first and last holder, vanished ones too."""
        for _ in range(MAX_READS):
            frames = _received(service.sockets.telemetry)
            if frames is None:
                return False
            if frames[0].bytes in (b"\x00", b"\x01"):
                self._is_subscribed = frames[0].bytes == b"\x01"
        return True

    def _say_losses(self, t_s: float) -> None:
        lost = sum(self.counters.values())
        if lost == self._lost_said or (self._t_said_s is not None and t_s - self._t_said_s < SAY_EVERY_S):
            return
        self._lost_said, self._t_said_s = lost, t_s
        said = ", ".join(f"{count} {why.replace('_', ' ')}" for why, count in self.counters.items() if count > 0)
        log.warning("clients: what was not taken from them so far: %s", said)


def _received(socket: Socket) -> Sequence[zmq.Frame] | None:
    """The parts of the next message, without waiting; those beyond what any client should send are thrown away."""
    if not int(socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:  # as nearly always: a quarter of what `zmq.Again` costs
        return None
    try:
        frames = [socket.recv(zmq.NOBLOCK, copy=False)]
    except zmq.Again:
        return None
    while socket.rcvmore:
        frame = socket.recv(copy=False)
        if len(frames) > MAX_PARTS:
            frames.pop()
        frames.append(frame)
    return frames


def _has_shape(frames: Sequence[zmq.Frame], shapes: tuple[int, ...]) -> bool:
    """The number of parts is one of `shapes`; a third part is the empty delimiter that REQ clients put between."""
    return len(frames) in shapes and (len(frames) < 3 or len(frames[1]) == 0)
