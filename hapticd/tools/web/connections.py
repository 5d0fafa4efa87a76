"""Bounds on the connections of pages' servers (view, study, gateway), which any process of this computer can open.

A connection is a stranger's until a request on it has brought the page's key. A stranger has STRANGER_S for that,
headers, answer and all, and gives way where there are too many: then the one that came first is closed. So idle
connections keep nobody out.
"""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import time
from collections.abc import Callable
from typing import Any

from aiohttp import web

MAX_CONNECTIONS, MAX_CONNECTIONS_PER_ADDRESS = 64, 32  # a browser has 6, and one for the socket of each page
ACCEPTS = 16  # per wake-up
STRANGER_S = 5.0
KEEP_ALIVE_S = 30.0
MESSAGES_HZ, BURST = 200.0, 100  # a page sends one per picture of the screen
LOG_EVERY_S = 10.0


class Connections:
    """The open connections of one server, strangers' in the order in which they came."""

    def __init__(self) -> None:
        self._strangers: dict[Connection, None] = {}
        self._known: set[Connection] = set()

    def __len__(self) -> int:
        return len(self._strangers) + len(self._known)

    def admit(self, connection: Connection) -> bool:
        """Return whether a connection may stay; a stranger's may be closed for it."""
        every = [*self._strangers, *self._known]
        own = [one for one in every if one.address == connection.address]
        is_crowded = len(own) >= MAX_CONNECTIONS_PER_ADDRESS
        if is_crowded or len(every) >= MAX_CONNECTIONS:
            first = next((one for one in (own if is_crowded else every) if one in self._strangers), None)
            if first is None:
                return False
            first.abort()
            self.forget(first)
        self._strangers[connection] = None
        return True

    def know(self, connection: Connection) -> None:
        """Take note that a request on this connection brought the key."""
        if self._strangers.pop(connection, connection) is None:
            self._known.add(connection)

    def is_stranger(self, connection: Connection) -> bool:
        """Return whether no request on an open connection has brought the key yet."""
        return connection in self._strangers

    def forget(self, connection: Connection) -> None:
        """Take note that a connection is closed."""
        self._strangers.pop(connection, None)
        self._known.discard(connection)


class Connection(web.RequestHandler):
    """aiohttp's protocol of one connection, if it is admitted, and until a stranger's time is over."""

    def __init__(self, connections: Connections, server: web.Server, loop: asyncio.AbstractEventLoop) -> None:
        options: dict[str, Any] = {"keepalive_timeout": KEEP_ALIVE_S, "access_log": None, "logger": logger()}
        super().__init__(server, loop=loop, **options)
        self.address = ""
        self._connections = connections
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.address = str((transport.get_extra_info("peername") or ("",))[0])
        if not self._connections.admit(self):
            transport.abort()
            return
        super().connection_made(transport)
        self._deadline = self._loop.call_later(STRANGER_S, self._give_up)

    def connection_lost(self, exc: BaseException | None) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        self._connections.forget(self)
        super().connection_lost(exc)

    def know(self) -> None:
        """Take note that a request brought the key."""
        self._connections.know(self)

    def abort(self) -> None:
        """Close without sending what waits."""
        if self.transport is not None:
            self.transport.abort()

    def _give_up(self) -> None:
        if self._connections.is_stranger(self):
            self.abort()


class Site(web.BaseSite):
    """Serves a runner's application at a listener within these bounds."""

    def __init__(self, runner: web.AppRunner, listener: socket.socket) -> None:
        super().__init__(runner)
        self._listener = listener
        self.connections = Connections()

    @property
    def name(self) -> str:
        """The address."""
        host, port = self._listener.getsockname()
        return f"http://{host}:{port}"

    async def start(self) -> None:
        """Accept connections."""
        await super().start()
        loop, server = asyncio.get_running_loop(), self._runner.server
        assert server is not None
        loop.set_exception_handler(report)
        self._server = await loop.create_server(
            lambda: Connection(self.connections, server, loop), sock=self._listener, backlog=ACCEPTS
        )


def know(request: web.Request) -> None:
    """Take note that a request brought the key."""
    if isinstance(request.protocol, Connection):
        request.protocol.know()


class Pace:
    """Spreads what one page sends: `rate_hz` in the long run, `burst` at once. What is beyond waits at the sender."""

    def __init__(self, rate_hz: float = MESSAGES_HZ, burst: int = BURST) -> None:
        self._period_s = 1.0 / rate_hz
        self._burst_s = burst / rate_hz
        self._t_next_s = -math.inf

    async def wait(self) -> None:
        """Return when the next message may be read."""
        t_s = asyncio.get_running_loop().time()
        self._t_next_s = max(self._t_next_s, t_s - self._burst_s) + self._period_s
        if self._t_next_s > t_s:
            await asyncio.sleep(self._t_next_s - t_s)


# --- the log: one sentence for what a peer does, and no traceback ------------------------------------------------


class PeerFilter(logging.Filter):
    """Passes one error of requests per LOG_EVERY_S, as a sentence; none for a malformed request, which gets a 400."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock_s = clock_s
        self._t_logged_s: float | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is logged, and shorten it."""
        from aiohttp.http_exceptions import HttpProcessingError

        error = record.exc_info[1] if record.exc_info else None
        if error is None:
            return True
        t_s = self._clock_s()
        is_early = self._t_logged_s is not None and t_s - self._t_logged_s < LOG_EVERY_S
        if is_early or isinstance(error, HttpProcessingError):
            return False
        self._t_logged_s = t_s
        first = (str(error).splitlines() or [""])[0]
        record.msg, record.args = "page: %s (%s: %s)", (record.getMessage(), type(error).__name__, first[:200])
        record.exc_info = record.exc_text = None
        return True


_FILTER = PeerFilter()


def logger() -> logging.Logger:
    """Return the servers' logger."""
    log = logging.getLogger("aiohttp.server")
    log.addFilter(_FILTER)
    return log


def report(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report what nobody handled on a server's loop; in a sentence if the system raised it, as without a descriptor."""
    error = context.get("exception")
    if isinstance(error, OSError):
        logger().error("%s", context["message"], exc_info=error)
    else:
        loop.default_exception_handler(context)
