"""Serving an application until the process is told to end."""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import web

from .connections import Site


@asynccontextmanager
async def served(runner: web.AppRunner, listener: socket.socket) -> AsyncIterator[asyncio.Event]:
    """Serve within the bounds of `Site`; the event is set by SIGTERM and SIGINT."""
    await runner.setup()
    try:
        await Site(runner, listener).start()
        ended = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, ended.set)
        yield ended
    finally:
        await runner.cleanup()
