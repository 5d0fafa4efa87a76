"""Serving an application within the bounds of `connections`, on the running loop or from a thread of its own."""

from __future__ import annotations

import asyncio
import signal
import socket
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TypeVarTuple

from aiohttp import web

from ...errors import HapticdError
from .connections import ACCEPTS, Connection, Connections, logger, report

START_WITHIN_S = 10.0
BACKLOG = 128
END_WITHIN_S = 1.0

_Arguments = TypeVarTuple("_Arguments")


def bound(host: str, port: int, option: str = "--port") -> socket.socket:
    """Return a socket bound to an address of this computer, port 0: any; `option` names it. Raises HapticdError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise HapticdError(
            f"Port {port} cannot be bound ({error.strerror}): choose another with {option}, or 0 for any."
        ) from None
    return listener


@asynccontextmanager
async def served(app: web.Application, listener: socket.socket) -> AsyncIterator[Connections]:
    """Serve at a listener, which is closed in the end."""
    connections, loop = Connections(), asyncio.get_running_loop()
    loop.set_exception_handler(report)
    runner = web.AppRunner(app, access_log=None, logger=logger(), shutdown_timeout=END_WITHIN_S)
    await runner.setup()
    try:
        handler = runner.server
        assert handler is not None
        server = await loop.create_server(
            lambda: Connection(connections, handler, loop), sock=listener, backlog=ACCEPTS
        )
        listener.listen(BACKLOG)  # more than asyncio accepts at once: one that finds it full tries again after 1 s
        try:
            yield connections
        finally:
            server.close()
    finally:
        await runner.cleanup()


def ended_by_signal() -> asyncio.Event:
    """Return an event that SIGTERM and SIGINT set."""
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    return ended


class ServingThread:
    """Context in which an application is served at a listener, for a command that has something else to do."""

    def __init__(self, app: web.Application, listener: socket.socket, name: str) -> None:
        self._serving = served(app, listener)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)

    def __enter__(self) -> ServingThread:
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._serving.__aenter__(), self._loop).result(START_WITHIN_S)
        return self

    def __exit__(self, *_: object) -> None:
        end = self._serving.__aexit__(None, None, None)
        asyncio.run_coroutine_threadsafe(end, self._loop).result(START_WITHIN_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def call_soon(self, what: Callable[[*_Arguments], object], *arguments: *_Arguments) -> None:
        """Call a function in that thread."""
        self._loop.call_soon_threadsafe(what, *arguments)
