"""An application of `hapticd.tools.web`, served on a test's loop."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import web

from hapticd.tools.web.serving import bound, served


@asynccontextmanager
async def running(app: web.Application) -> AsyncIterator[int]:
    """Yield the server's port."""
    listener = bound("127.0.0.1", 0)
    port: int = listener.getsockname()[1]
    async with served(app, listener):
        yield port
