"""Serving an application within the bounds of `Site`: until a signal ends the process, or from a thread of its own."""

from __future__ import annotations

import asyncio
import signal
import socket
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TypeVarTuple

from aiohttp import web

from .connections import Site

START_WITHIN_S = 10.0

_Arguments = TypeVarTuple("_Arguments")


@asynccontextmanager
async def served(runner: web.AppRunner, listener: socket.socket) -> AsyncIterator[asyncio.Event]:
    """Serve; the event is set by SIGTERM and SIGINT."""
    await runner.setup()
    try:
        await Site(runner, listener).start()
        ended = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, ended.set)
        yield ended
    finally:
        await runner.cleanup()


class ServingThread:
    """Context in which an application is served at a listener, for a command that has something else to do."""

    def __init__(self, runner: web.AppRunner, listener: socket.socket, name: str) -> None:
        self._runner, self._listener = runner, listener
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)

    def __enter__(self) -> ServingThread:
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._start(), self._loop).result(START_WITHIN_S)
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._runner.cleanup(), self._loop).result(START_WITHIN_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def call_soon(self, what: Callable[[*_Arguments], object], *arguments: *_Arguments) -> None:
        """Call a function in that thread."""
        self._loop.call_soon_threadsafe(what, *arguments)

    async def _start(self) -> None:
        await self._runner.setup()
        await Site(self._runner, self._listener).start()
