"""A gateway on this test's loop, and programs that connect to it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse
from asynchronous import PATIENCE_S
from web_apps import running

from hapticd.tools.gateway.server import Gateway
from hapticd.tools.web.application import application
from hapticd_client.endpoint import Endpoint

KEY = "0123456789abcdef"
ORIGIN = "http://localhost:8000"


@asynccontextmanager
async def gateway(folder: Path) -> AsyncIterator[str]:
    """Yield the address of a gateway of the daemon in this folder."""
    app = application("gateway", KEY, origins=(ORIGIN,))
    Gateway(lambda: Endpoint(folder)).add_to(app)
    async with running(app) as port:
        yield f"ws://127.0.0.1:{port}/client"


class Program:
    """A client of the gateway."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self.socket = socket
        self._id = 0

    async def send(self, **fields: Any) -> None:
        await self.socket.send_str(json.dumps({"v": 1, **fields}))

    async def next(self, wanted: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """Return the next message that is wanted; others are dropped."""
        async with asyncio.timeout(PATIENCE_S):
            while not wanted(message := json.loads(await self.socket.receive_str())):
                pass
        return dict(message)

    async def ask(self, op: str, **body: Any) -> dict[str, Any]:
        """Return the reply to a request."""
        self._id += 1
        await self.send(id=self._id, op=op, **({"body": body} if body else {}))
        return await self.next(lambda message: message.get("id") == self._id)


@asynccontextmanager
async def programs(folder: Path, count: int = 1) -> AsyncIterator[list[Program]]:
    """Yield programs that are connected to one gateway."""
    async with gateway(folder) as address, ClientSession() as session:
        yield [Program(await session.ws_connect(f"{address}?key={KEY}")) for _ in range(count)]
