"""Client server: ZeroMQ over ipc, and over TCP for clients with a key, on the daemon's event loop.

    targets    PULL    one-part messages in; each replaces its client's earlier targets
    control    ROUTER  requests in, replies out
    telemetry  XPUB    states out, subscriptions in

A ZeroMQ file descriptor is edge-triggered, and any call on the socket may consume the edge. So every wake-up and every
send reads to the end, and `sweep`, called periodically by the daemon, finds what a consumed edge left behind.
zmq.asyncio is not used for messages: it receives five times slower, and its tail is a tick long under load.

A flood cannot block the loop: a wake-up reads each socket for BUDGET_S, then pauses for BREAK_S, or for as long as it
took where messages are dear or the machine is slow; each sender has a rate limit (senders.py). Losses are counted and
logged.
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
from .gate import CAUSES, Gate
from .runtime_dir import endpoint_path, locked, own_directory, runtime_directory
from .senders import RateLimiter, Sender, sender_of
from .sockets import ENDPOINTS, MAX_MESSAGE_BYTES, AllowList, Remote, Socket, Sockets, bound, open_doors

__all__ = ["MAX_MESSAGE_BYTES", "ClientServer", "runtime_directory"]

log = logging.getLogger("hapticd")

MAX_READS = 64  # per socket and wake-up, so that a flood cannot delay the tick
BUDGET_S = 0.0005  # the same in time, for messages that are slow to read
BREAK_S = 0.005  # between wake-ups under a flood, at least
MAX_PARTS = 3  # of a request: identity, an empty delimiter from REQ clients, payload
REQUESTS_WAITING = 8  # queued per sender beyond its rate; of `targets` only the newest matters
LOG_EVERY_S = 10.0  # shortest time between two log lines about losses

Parts = list[bytes]
_Message = tuple[Sender, Parts]


@dataclass(frozen=True, slots=True)
class _Service:
    """State between `start` and `close`."""

    loop: asyncio.AbstractEventLoop
    sockets: Sockets
    gate: Gate
    on_message: Callable[[bytes, str], None]
    on_request: Callable[[bytes, str], bytes]
    on_listener: Callable[[], None]
    refusal_of_parts: bytes


class ClientServer:
    """Serves clients in `runtime_dir` from `start` to `close`, and over TCP those whose keys `remote` allows."""

    def __init__(self, runtime_dir: Path, remote: Remote | None = None) -> None:
        self.misshapen = 0  # messages with a wrong number of parts
        self._directory = runtime_dir
        self._remote = remote
        self._allow_list = None if remote is None else AllowList(remote)
        self._key_names = {} if remote is None else remote.keys.clients
        self._lock_fd: int | None = None
        self._service: _Service | None = None
        self._break: asyncio.TimerHandle | None = None
        self.has_subscribers = False  # of telemetry
        self._messages: RateLimiter[_Message] = RateLimiter(queue_length=1)
        self._requests: RateLimiter[_Message] = RateLimiter(queue_length=REQUESTS_WAITING)
        self._losses_logged = 0
        self._t_logged_s: float | None = None

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_message: Callable[[bytes, str], None],
        on_request: Callable[[bytes, str], bytes],
        on_listener: Callable[[], None] = lambda: None,
        refusal_of_parts: bytes = b"",
    ) -> None:
        """Lock the directory, bind, and serve on `loop`. Raises AlreadyRunningError, or HapticdError for the directory.

        `on_message` receives each payload of `targets` and its user, `on_request` answers each payload of `control`,
        `on_listener` is called at the first telemetry subscription. All are called on the loop and must not raise.
        `refusal_of_parts` answers a request in several parts. With `remote`, call it on the running loop.
        """
        own_directory(self._directory)
        paths = [endpoint_path(self._directory, name) for name in ENDPOINTS]
        self._lock_fd = locked(self._directory / "lock")
        gate = Gate(loop)
        try:
            sockets = bound(paths, self._remote, self._allow_list)
            self._service = _Service(loop, sockets, gate, on_message, on_request, on_listener, refusal_of_parts)
            open_doors(gate, paths, self._remote)
        except (zmq.ZMQError, OSError) as error:
            self.close()
            where = self._directory if self._remote is None else f"{self._directory}, TCP port {self._remote.port}"
            raise HapticdError(f"{where}: clients cannot be served here ({error.strerror}).") from None
        except HapticdError:
            self.close()
            raise
        for socket in sockets.all:
            loop.add_reader(socket.FD, self._on_edge)
        self.sweep()  # an edge before add_reader would be missed

    @property
    def counters(self) -> dict[str, int]:
        """Dropped messages and connections by reason: rate limit, number of parts, key not allowed, and the gate's."""
        return {
            "too_fast": self._messages.lost + self._requests.lost,
            "misshapen": self.misshapen,
            "denied": 0 if self._allow_list is None else self._allow_list.denied,
            **(dict.fromkeys(CAUSES, 0) if self._service is None else self._service.gate.counters),
        }

    def publish(self, payload: bytes) -> None:
        """Send a state to all subscribers; dropped for those that are too slow."""
        if self._service is None or not self.has_subscribers:
            return
        self._service.sockets.telemetry.send(payload, zmq.NOBLOCK)
        self._read_subscriptions(self._service)  # the send may have consumed the edge of a subscription

    def sweep(self) -> None:
        """Read all sockets to the end, or for their time budget; never blocks."""
        service = self._service
        if service is None:
            return
        t_s = service.loop.time()
        more = self._read_targets(service)
        more |= self._read_requests(service)
        had_listener = self.has_subscribers
        more |= self._read_subscriptions(service)
        if self.has_subscribers and not had_listener:
            service.on_listener()
        if more and self._break is None:  # what is still waiting raises no new edge
            took_s = service.loop.time() - t_s
            self._break = service.loop.call_later(max(BREAK_S, took_s), self._resume)
        self._log_losses(t_s)

    def close(self) -> None:
        """Stop serving, remove the sockets, then release the lock. Safe to call twice, and after a failed start."""
        if self._break is not None:
            self._break.cancel()
            self._break = None
        if self._service is not None:
            for socket in self._service.sockets.all:
                self._service.loop.remove_reader(socket.FD)
            self._service.sockets.close()
            self._service.gate.close()
            self._service = None
        self.has_subscribers = False
        if self._lock_fd is not None:
            os.close(self._lock_fd)
            self._lock_fd = None

    def _on_edge(self) -> None:
        if self._break is None or self._service is None:
            self.sweep()
            return
        for socket in self._service.sockets.all:  # reading its events consumes the edge without ending the break
            socket.get(zmq.EVENTS)

    def _resume(self) -> None:
        self._break = None
        self.sweep()

    # --- each returns True if more may be waiting ---

    def _read_targets(self, service: _Service) -> bool:
        def handle(sender: Sender, parts: Parts) -> None:
            service.on_message(parts[0], sender.user)

        return self._read(service, service.sockets.targets, self._messages, (1,), handle)

    def _read_requests(self, service: _Service) -> bool:
        socket = service.sockets.control

        def handle(sender: Sender, parts: Parts) -> None:
            socket.send_multipart([*parts[:-1], service.on_request(parts[-1], sender.user)], zmq.NOBLOCK)

        return self._read(service, socket, self._requests, (2, 3), handle)

    def _read(
        self,
        service: _Service,
        socket: Socket,
        rate_limiter: RateLimiter[_Message],
        shapes: tuple[int, ...],
        handle: Callable[[Sender, Parts], None],
    ) -> bool:
        """Handle waiting messages within rate and budget; `shapes` are the valid numbers of parts."""
        loop = service.loop
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
            sender, parts = sender_of(frames[-1], self._key_names), [frame.bytes for frame in frames]
            if sender.connection is not None and service.gate.is_stale(sender.connection):
                continue
            if not _has_shape(frames, shapes):
                self.misshapen += 1
                if socket is service.sockets.control:
                    envelope = parts[: 2 if len(parts[1]) == 0 else 1]
                    socket.send_multipart([*envelope, service.refusal_of_parts], zmq.NOBLOCK)
            elif rate_limiter.admit(sender.source, (sender, parts), t_s):
                handle(sender, parts)
            if loop.time() >= t_end_s:
                return True
        return True

    def _read_subscriptions(self, service: _Service) -> bool:
        """Track the subscription to everything; ZeroMQ reports its first and last subscriber."""
        for _ in range(MAX_READS):
            frames = _received(service.sockets.telemetry)
            if frames is None:
                return False
            if frames[0].bytes in (b"\x00", b"\x01"):
                self.has_subscribers = frames[0].bytes == b"\x01"
        return True

    def _log_losses(self, t_s: float) -> None:
        lost = sum(self.counters.values())
        if lost == self._losses_logged or (self._t_logged_s is not None and t_s - self._t_logged_s < LOG_EVERY_S):
            return
        self._losses_logged, self._t_logged_s = lost, t_s
        losses = ", ".join(f"{count} {why.replace('_', ' ')}" for why, count in self.counters.items() if count > 0)
        log.warning("clients: messages dropped so far: %s", losses)


def _received(socket: Socket) -> Sequence[zmq.Frame] | None:
    """Receive the parts of the next message without blocking; parts beyond MAX_PARTS are discarded."""
    if not int(socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:  # the usual case: a quarter of the cost of `zmq.Again`
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
    """Return whether the number of parts is one of `shapes`; with three, the second is a REQ client's delimiter."""
    return len(frames) in shapes and (len(frames) < 3 or len(frames[1]) == 0)
