"""An application of `hapticd.tools.web`, served on a test's loop."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import web

from hapticd.tools.web.connections import Connections
from hapticd.tools.web.serving import bound, served


@asynccontextmanager
async def running(app: web.Application) -> AsyncIterator[tuple[Connections, int]]:
    """Yield the server's connections and its port."""
    listener = bound("127.0.0.1", 0)
    port: int = listener.getsockname()[1]
    async with served(app, listener) as connections:
        yield connections, port
