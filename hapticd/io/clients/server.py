"""Client server: ZeroMQ over ipc, and over TCP for clients with a key, on the daemon's event loop.

    targets    PULL    one-part messages in; each replaces its client's earlier targets
    control    ROUTER  requests in, replies out
    telemetry  XPUB    states out, subscriptions in

Each connection to the first two has a socket of its own (inbox.py), handled round robin; all subscribers share one.

A ZeroMQ file descriptor is edge-triggered, and any call on the socket may consume the edge. So each turn ends with a
look for more, each send reads to the end, and `sweep`, called periodically by the daemon, finds what a consumed edge
left. zmq.asyncio is not used for messages: it receives five times slower, and its tail is a tick long under load.

A flood cannot block the loop: a wake-up handles messages for BUDGET_S, then pauses for BREAK_S, or for as long as it
took where messages are expensive or the machine is slow; each connection has a rate limit. A client that leaves replies
unread gets no further ones. Losses are counted and logged.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import zmq

from ...errors import HapticdError
from .gate import CAUSES, Gate, Listener
from .inbox import MAX_READS, Inbox, received
from .listeners import inner_path, local_listener, remote_listener
from .runtime_dir import endpoint_path, locked, own_directory, runtime_directory
from .sockets import ENDPOINTS, MAX_MESSAGE_BYTES, AllowList, Remote, Sockets

__all__ = ["MAX_MESSAGE_BYTES", "ClientServer", "runtime_directory"]

log = logging.getLogger("hapticd")

BUDGET_S = 0.0005  # of a wake-up, so that a flood cannot delay the tick
BREAK_S = 0.005  # between wake-ups under a flood, at least
LOG_EVERY_S = 10.0  # shortest time between two log lines about losses

OnMessage = Callable[[bytes, str, int], None]  # payload, user, and for how many ns it has waited
OnRequest = Callable[[bytes, str, int], bytes]


@dataclass(frozen=True, slots=True)
class _Service:
    """State between `start` and `close`."""

    loop: asyncio.AbstractEventLoop
    sockets: Sockets
    gate: Gate
    on_message: OnMessage
    on_request: OnRequest
    on_listener: Callable[[], None]
    refusal_of_parts: bytes


class ClientServer:
    """Serves clients in `runtime_dir` from `start` to `close`, and over TCP those whose keys `remote` allows."""

    def __init__(self, runtime_dir: Path, remote: Remote | None = None) -> None:
        self._directory = runtime_dir
        self._remote = remote
        self._allow_list = None if remote is None else AllowList(remote)
        self._key_names = {} if remote is None else remote.keys.clients
        self._lock_fd: int | None = None
        self._service: _Service | None = None
        self._break: asyncio.TimerHandle | None = None
        self.has_subscribers = False  # of telemetry
        self._inboxes: dict[int, Inbox] = {}  # by the descriptor of each one's socket
        self._ready: dict[Inbox, None] = {}  # with messages, the next one first
        self._lost = {"too_fast": 0, "misshapen": 0}
        self._losses_logged = 0
        self._t_logged_s: float | None = None

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_message: OnMessage,
        on_request: OnRequest,
        on_listener: Callable[[], None] = lambda: None,
        refusal_of_parts: bytes = b"",
    ) -> None:
        """Lock the directory, bind, and serve on `loop`. Raises AlreadyRunningError, or HapticdError for the directory.

        `on_message` receives the newest payload of each client of `targets`, its user and for how many ns it has
        waited, `on_request` answers each payload of `control`, `on_listener` is called at the first telemetry
        subscription. All are called on the loop and must not raise.
        `refusal_of_parts` answers a request in several parts. With `remote`, call it on the running loop.
        """
        own_directory(self._directory)
        paths = [endpoint_path(self._directory, name) for name in ENDPOINTS]
        self._lock_fd = locked(self._directory / "lock")
        gate = Gate(loop)
        try:
            sockets = Sockets(paths, self._remote, self._allow_list)
            self._service = _Service(loop, sockets, gate, on_message, on_request, on_listener, refusal_of_parts)
            self._listen(gate, paths)
        except (zmq.ZMQError, OSError) as error:
            self.close()
            where = self._directory if self._remote is None else f"{self._directory}, TCP port {self._remote.port}"
            raise HapticdError(f"{where}: clients cannot be served here ({error.strerror}).") from None
        except HapticdError:
            self.close()
            raise
        loop.add_reader(sockets.telemetry.FD, self._on_subscriptions)
        self.sweep()  # an edge before add_reader would be missed

    @property
    def counters(self) -> dict[str, int]:
        """Dropped messages and connections by reason: rate limit, number of parts, key not allowed, and the gate's."""
        return {
            **self._lost,
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
        """Look at all sockets, and handle what waits for the time budget; never blocks."""
        if self._service is None:
            return
        self._ready.update(dict.fromkeys(inbox for inbox in self._inboxes.values() if inbox.has_more))
        self._handle_some()
        self._on_subscriptions()

    def close(self) -> None:
        """Stop serving, remove the sockets, then release the lock. Safe to call twice, and after a failed start."""
        if self._break is not None:
            self._break.cancel()
            self._break = None
        if self._service is not None:
            self._service.loop.remove_reader(self._service.sockets.telemetry.FD)
            self._service.gate.close()
            self._service.sockets.close()
            self._service = None
        self.has_subscribers = False
        if self._lock_fd is not None:
            os.close(self._lock_fd)
            self._lock_fd = None

    # --- connections ---

    def _listen(self, gate: Gate, paths: Sequence[Path]) -> None:
        """Accept clients at the public paths of ENDPOINTS and at `remote`'s ports. Raises HapticdError, OSError."""
        for index, (path, kind) in enumerate(zip(paths, ENDPOINTS.values(), strict=True)):
            inbox = None if kind == zmq.XPUB else partial(self._attach, kind)
            gate.open(Listener(local_listener(path), inner_path(path), inbox))
            if self._remote is not None:
                socket = remote_listener(self._remote.host, self._remote.port + index)
                gate.open(Listener(socket, inner_path(path, is_remote=True), inbox))

    def _attach(self, kind: int, path: Path, user: str | None) -> Inbox:
        """Bind a socket for one connection. Raises zmq.ZMQError, HapticdError."""
        assert self._service is not None
        loop = self._service.loop
        socket = self._service.sockets.bound(kind, path, is_remote=user is None)
        inbox = Inbox(socket, user, self._lost, loop.time, self._detach)
        self._inboxes[inbox.fd] = inbox
        loop.add_reader(inbox.fd, self._on_edge, inbox)
        return inbox

    def _detach(self, inbox: Inbox) -> None:
        assert self._service is not None
        if not self._service.loop.is_closed():
            self._service.loop.remove_reader(inbox.fd)
        del self._inboxes[inbox.fd]
        self._ready.pop(inbox, None)

    # --- messages ---

    def _on_edge(self, inbox: Inbox) -> None:
        if inbox.has_more:
            self._ready[inbox] = None
            if self._break is None:
                self._handle_some()

    def _resume(self) -> None:
        self._break = None
        self._handle_some()

    def _handle_some(self) -> None:
        """Handle messages of each client in turn, for the time budget."""
        service = self._service
        if service is None or self._break is not None:
            return
        loop = service.loop
        t_s = loop.time()
        held = []
        while self._ready:
            inbox = next(iter(self._ready))
            del self._ready[inbox]
            if inbox.is_behind or not inbox.read(service.refusal_of_parts):
                continue
            user = inbox.user_by(self._key_names)
            if not inbox.admit(t_s):
                held.append(inbox)
                continue
            self._handle(service, inbox, user)
            if inbox.has_more:
                self._ready[inbox] = None
            if loop.time() - t_s >= BUDGET_S:
                break
        self._ready.update(dict.fromkeys(held))
        took_s = loop.time() - t_s
        if self._ready or took_s >= BUDGET_S:  # what is still waiting raises no new edge
            self._break = loop.call_later(max(BREAK_S, took_s), self._resume)
        self._log_losses(t_s)

    @staticmethod
    def _handle(service: _Service, inbox: Inbox, user: str) -> None:
        frames, t_arrived_s = inbox.pop()
        payload, waited_ns = frames[-1].bytes, round(1e9 * (service.loop.time() - t_arrived_s))
        if inbox.is_control:
            inbox.reply(frames[:-1], service.on_request(payload, user, waited_ns))
        else:
            service.on_message(payload, user, waited_ns)

    # --- telemetry ---

    def _on_subscriptions(self) -> None:
        service, had_listener = self._service, self.has_subscribers
        if service is not None:
            self._read_subscriptions(service)
            if self.has_subscribers and not had_listener:
                service.on_listener()

    def _read_subscriptions(self, service: _Service) -> None:
        """Track the subscription to everything; ZeroMQ reports its first and last subscriber."""
        for _ in range(MAX_READS):
            frames = received(service.sockets.telemetry)
            if frames is None:
                return
            if frames[0].bytes in (b"\x00", b"\x01"):
                self.has_subscribers = frames[0].bytes == b"\x01"

    def _log_losses(self, t_s: float) -> None:
        lost = sum(self.counters.values())
        if lost == self._losses_logged or (self._t_logged_s is not None and t_s - self._t_logged_s < LOG_EVERY_S):
            return
        self._losses_logged, self._t_logged_s = lost, t_s
        losses = ", ".join(f"{count} {why.replace('_', ' ')}" for why, count in self.counters.items() if count > 0)
        log.warning("clients: messages dropped so far: %s", losses)
