"""Serving an application from a thread of its own, for a command that has something else to do."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable
from typing import TypeVarTuple

from aiohttp import web

from .connections import Site

START_WITHIN_S = 10.0

_Arguments = TypeVarTuple("_Arguments")


class ServingThread:
    """Context in which an application is served at a listener within the bounds of `Site`."""

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
