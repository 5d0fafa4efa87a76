"""Bounds on the connections of a server, which any process of this computer can open.

A connection is a stranger's until a request on it has brought the key. It has STRANGER_S for that, headers, answer and
all, where it is alone, and less the more strangers there are: so idle connections keep no one out, and none is closed
because of a later one.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Any

from aiohttp import web

MAX_KNOWN = 64  # a browser has 6, and one for the socket of each page
MAX_STRANGERS = 256
ACCEPTS = 16  # per wake-up
STRANGER_S = 5.0
KEEP_ALIVE_S = 30.0
LOG_EVERY_S = 10.0


class Connections:
    """The open connections of one server."""

    def __init__(self) -> None:
        self.known: set[Connection] = set()
        self.strangers: set[Connection] = set()

    def __len__(self) -> int:
        return len(self.known) + len(self.strangers)


class Connection(web.RequestHandler):
    """aiohttp's protocol of one connection, until a stranger's time is over."""

    def __init__(self, connections: Connections, server: web.Server, loop: asyncio.AbstractEventLoop) -> None:
        options: dict[str, Any] = {"keepalive_timeout": KEEP_ALIVE_S, "access_log": None, "logger": logger()}
        super().__init__(server, loop=loop, **options)
        self._connections = connections
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        strangers = self._connections.strangers
        if len(strangers) >= MAX_STRANGERS:
            transport.abort()
            return
        super().connection_made(transport)
        time_s = STRANGER_S * (1.0 - len(strangers) / MAX_STRANGERS) ** 2
        self._deadline = self._loop.call_later(time_s, transport.abort)
        strangers.add(self)

    def connection_lost(self, exc: BaseException | None) -> None:
        self._end_of_strangers_time()
        self._connections.known.discard(self)
        super().connection_lost(exc)

    def know(self) -> bool:
        """Note that a request brought the key; return whether the connection may stay."""
        known = self._connections.known
        if self not in known and len(known) >= MAX_KNOWN:
            return False
        self._end_of_strangers_time()
        known.add(self)
        return True

    def _end_of_strangers_time(self) -> None:
        self._connections.strangers.discard(self)
        if self._deadline is not None:
            self._deadline.cancel()


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
