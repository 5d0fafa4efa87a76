"""The gateway's web application, whose only page is the WebSocket `/client?key=..`; the viewer has that, too."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import AsyncIterator, Awaitable, Callable, Collection

import zmq.asyncio
from aiohttp import WSCloseCode, web

from hapticd_client.endpoint import Endpoint

from ...errors import HapticdError
from ..web import connections, guard
from .feed import Feed
from .messages import MAX_TEXT_BYTES
from .osc_clients import OscClients
from .peer import Names, Peer, Turns

PATH = "/client"
MAX_PEERS = 16  # of the 64 connections that the daemon grants a user, each has two and all together one
HEARTBEAT_S = 10.0
END_WITHIN_S = 1.0

_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Gateway:
    """All WebSockets of one daemon."""

    def __init__(
        self,
        endpoint: Endpoint,
        key: str,
        origins: Collection[str] = (),
        hosts: tuple[str, ...] = guard.HOSTS,
        osc_port: int | None = None,
    ) -> None:
        """`origins` are those of pages that may connect, besides programs, and `hosts` the names of this server.

        With `osc_port` it has clients by OSC, too; 0 is any port, and then `osc_port` tells which.
        """
        self.osc_port = osc_port
        self.port = 0
        self._endpoint = endpoint
        self._key = key
        self._origins = frozenset(origins)
        self._hosts = hosts
        self._opened = 0
        self._sockets: weakref.WeakSet[web.WebSocketResponse] = weakref.WeakSet()

    def runner(self) -> web.AppRunner:
        """The server of the application; `port` must be set before it serves."""
        app = web.Application(middlewares=[self._guarded])
        self.add_to(app)
        return web.AppRunner(app, access_log=None, logger=connections.logger(), shutdown_timeout=END_WITHIN_S)

    def add_to(self, app: web.Application) -> None:
        """Serve PATH in an application that admits who may come in."""
        app.router.add_get(PATH, self._client)
        app.cleanup_ctx.append(self._run)
        app.on_shutdown.append(self._close)

    async def _run(self, _: web.Application) -> AsyncIterator[None]:
        self._context = zmq.asyncio.Context()
        self._feed, self._names = Feed(self._context, self._endpoint), Names()
        self._targets, self._requests = Turns(), Turns()
        osc = None if self.osc_port is None else await self._listen_to_osc(self.osc_port)
        yield
        if osc is not None:
            await osc.close()
        self._context.destroy(linger=0)

    async def _listen_to_osc(self, port: int) -> OscClients:
        clients = OscClients(self._context, self._endpoint, self._feed)
        loop = asyncio.get_running_loop()
        try:
            transport, _ = await loop.create_datagram_endpoint(lambda: clients, (guard.HOSTS[0], port))
        except OSError as error:
            self._context.destroy(linger=0)
            raise HapticdError(f"--osc: port {port} cannot be bound ({error.strerror}): choose another.") from None
        self.osc_port = transport.get_extra_info("sockname")[1]
        return clients

    async def _close(self, _: web.Application) -> None:
        await asyncio.gather(*(socket.close(code=WSCloseCode.GOING_AWAY) for socket in tuple(self._sockets)))

    @web.middleware
    async def _guarded(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        why = guard.refusal(
            self.port, request.headers, needs_origin=False, hosts=self._hosts, origins=self._origins
        ) or ("" if guard.has_key(request.query.get("key", ""), self._key) else "The address needs the gateway's key.")
        if why:
            return web.Response(status=403, text=why + "\n", headers=guard.headers(self.port))
        connections.know(request)
        return await handler(request)

    async def _client(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(max_msg_size=MAX_TEXT_BYTES, heartbeat=HEARTBEAT_S, compress=False)
        await socket.prepare(request)
        if len(self._sockets) >= MAX_PEERS:  # within the socket: a browser hides the reason of a refused one
            why = f"{MAX_PEERS} connections are open already: close one."
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=why.encode())
            return socket
        self._sockets.add(socket)
        self._opened += 1
        try:
            peer = Peer(self._opened, self._context, self._endpoint, self._feed, self._names)
            await peer.relay(socket, self._targets, self._requests)
        finally:
            self._sockets.discard(socket)
            await socket.close()
        return socket
