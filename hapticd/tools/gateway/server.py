"""The gateway's web application, whose only page is the WebSocket `/client?key=..`; the viewer has that, too."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import AsyncIterator, Callable

from aiohttp import WSCloseCode, web

import hapticd_client
from hapticd_client.endpoint import Endpoint

from ...errors import HapticdError
from ..web.application import HOSTS
from ..web.sockets import opened
from .messages import MAX_TEXT_BYTES
from .osc_clients import OscClients
from .peer import Peer
from .shared_daemon import SharedDaemon

PATH = "/client"
MAX_REASON_BYTES = 123  # of a WebSocket's closing
MAX_PEERS = 16  # of the 64 connections that the daemon grants its computer, each has two and all together one


class Gateway:
    """All WebSockets of the daemon that `find` returns, and with `osc_port` all OSC senders; 0 is any port, and then it
    tells which."""

    def __init__(self, find: Callable[[], Endpoint], osc_port: int | None = None) -> None:
        self.osc_port = osc_port
        self._find = find
        self._sockets: weakref.WeakSet[web.WebSocketResponse] = weakref.WeakSet()

    def add_to(self, app: web.Application) -> None:
        """Serve PATH in an application that admits who may come in."""
        app.router.add_get(PATH, self._client)
        app.cleanup_ctx.append(self._run)
        app.on_shutdown.append(self._close)

    async def _run(self, _: web.Application) -> AsyncIterator[None]:
        self._daemon = SharedDaemon(self._find)
        osc = None if self.osc_port is None else await self._listen_to_osc(self.osc_port)
        yield
        if osc is not None:
            await osc.close()
        self._daemon.close()

    async def _listen_to_osc(self, port: int) -> OscClients:
        clients = OscClients(self._daemon)
        loop = asyncio.get_running_loop()
        try:
            transport, _ = await loop.create_datagram_endpoint(lambda: clients, (HOSTS[0], port))
        except OSError as error:
            self._daemon.close()
            raise HapticdError(f"--osc: port {port} cannot be bound ({error.strerror}): choose another.") from None
        self.osc_port = transport.get_extra_info("sockname")[1]
        return clients

    async def _close(self, _: web.Application) -> None:
        await asyncio.gather(*(socket.close(code=WSCloseCode.GOING_AWAY) for socket in tuple(self._sockets)))

    async def _client(self, request: web.Request) -> web.StreamResponse:
        socket = await opened(request, MAX_TEXT_BYTES, self._sockets, MAX_PEERS)
        if not socket.closed:
            self._sockets.add(socket)
            try:
                await Peer(self._daemon).relay(socket)
            except hapticd_client.HapticdError as error:
                await socket.close(message=str(error).encode()[:MAX_REASON_BYTES])
            finally:
                self._sockets.discard(socket)
                await socket.close()
        return socket
