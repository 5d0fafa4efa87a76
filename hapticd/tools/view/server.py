"""Serves the page on this computer, and each open page a websocket. One asyncio loop; the client has its own thread.

/            the page, for who brings the key     /shapes           the plate's mode shapes, float32
/<file>      its styles and scripts               /layer?name=..    laid over the picture for &finger=.. (layers.py)
/socket      frames out, wishes in (messages.py)
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Awaitable, Callable
from functools import partial
from importlib import resources

import zmq
from aiohttp import WSCloseCode, WSMsgType, web

from ...errors import RequestError
from ...sim.fingers.hands import MAX_HANDS, Point
from . import guard, layers, messages
from .client import Plate, PlateClient
from .messages import ClearFault, Hold, Want
from .rig import PadHand

TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
KEYED = ("/", "/shapes", "/layer", "/socket")  # what is more than the page's own files
MAX_PAGES = 8
MAX_WANTED = 16  # fingers that a client may hold
HOLD_EVERY_S = 0.15  # the rig lets go of who is silent for three times as long

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Page:
    """One open page: what it must still be told, what it holds on the pad, what it asked for."""

    def __init__(self, socket: web.WebSocketResponse, number: int) -> None:
        self.socket = socket
        self.number = number
        self.held: dict[str, Point] = {}
        self.wanted: dict[int | str, None] = {}  # the newest MAX_WANTED, in their order
        self._waiting: dict[str, str] = {}  # by kind: only the newest of each counts
        self._news = asyncio.Event()

    def tell(self, kind: str, text: str) -> None:
        """Send it soon; a page that does not keep up misses those before."""
        self._waiting.pop(kind, None)
        self._waiting[kind] = text
        self._news.set()

    def remember(self, wish: Want) -> None:
        """What is given up for this page when it closes."""
        self.wanted.pop(wish.finger, None)
        if wish.amplitude_um is not None:
            self.wanted[wish.finger] = None
        if len(self.wanted) > MAX_WANTED:
            del self.wanted[next(iter(self.wanted))]

    async def write(self) -> None:
        """Send what there is, until cancelled or the page is gone."""
        while not self.socket.closed:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                kind = next(iter(self._waiting))
                await self.socket.send_str(self._waiting.pop(kind))


class Viewer:
    """All open pages, and the client that they share while there are any."""

    def __init__(self, endpoint: str | None, key: str | None = None) -> None:
        self.key = secrets.token_urlsafe(16) if key is None else key
        self.port = 0
        self._endpoint = endpoint
        self._pages: list[Page] = []
        self._opened = 0
        self._client: PlateClient | None = None
        self._plate: Plate | None = None
        self._last: dict[str, str] = {}
        self._context = zmq.Context()
        self._hand: PadHand | None = None
        self._closing: set[asyncio.Task[None]] = set()
        self._layering = asyncio.Lock()  # pages wait for each other's layers, not the pictures for all of them

    def app(self) -> web.Application:
        """The web application; `port` must be set before it is served."""
        app = web.Application(middlewares=[self._guarded])
        app.router.add_get("/", self._index)
        app.router.add_get("/shapes", self._shapes)
        app.router.add_get("/layer", self._layer)
        app.router.add_get("/socket", self._socket)
        for entry in resources.files(__package__).joinpath("page").iterdir():
            if entry.name != "index.html" and entry.name.rpartition(".")[2] in TYPES:
                app.router.add_get(f"/{entry.name}", partial(_file, entry.name))
        app.on_shutdown.append(self._close)
        return app

    # --- answers ---

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        why = guard.refusal(self.port, request.headers, is_socket=request.path == "/socket")
        if not why and request.path in KEYED:
            is_known = guard.has_key(request.query.get("key", ""), self.key)
            why = "" if is_known else "Open the address that `hapticd view` printed: it ends with a key."
        if why:
            return web.Response(status=403, text=why + "\n", headers=guard.headers(self.port))
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(guard.headers(self.port))
            raise
        if not response.prepared:
            response.headers.update(guard.headers(self.port))
        return response

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return await _file("index.html", request)

    async def _shapes(self, _: web.Request) -> web.StreamResponse:
        if self._plate is None:
            raise web.HTTPNotFound(text="No plate is known yet.\n")
        return web.Response(body=self._plate.grid, content_type="application/octet-stream")

    async def _layer(self, request: web.Request) -> web.StreamResponse:
        plate = self._plate
        if plate is None:
            raise web.HTTPNotFound(text="No plate is known yet.\n")
        name, fingers = request.query.get("name", ""), plate.fingers
        try:
            mover = messages.mover(request.query.get("finger", ""))
            async with self._layering:
                levels = await asyncio.to_thread(
                    layers.picture, name, plate.modes, fingers, plate.reference_limit_um, plate.size_mm, mover
                )
        except RequestError as error:
            raise web.HTTPNotFound(text=f"{error}\n") from None
        return web.Response(body=levels, content_type="application/octet-stream")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(max_msg_size=messages.MAX_MESSAGE_BYTES, heartbeat=10.0)
        await socket.prepare(request)
        if len(self._pages) >= MAX_PAGES:  # said within the socket: of a refused one a browser hides why
            why = f"{MAX_PAGES} pages are open already: close one."
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=why.encode())
            return socket
        self._opened += 1
        page = Page(socket, self._opened)
        self._enter(page)
        writing = asyncio.ensure_future(page.write())
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    self._hear(page, message.data)
        finally:
            writing.cancel()
            await asyncio.gather(writing, return_exceptions=True)
            self._leave(page)
        return socket

    # --- pages ---

    def _enter(self, page: Page) -> None:
        for kind, text in self._last.items():
            page.tell(kind, text)
        self._pages.append(page)
        if self._client is None:
            loop = asyncio.get_running_loop()

            def tell(kind: str, text: str, plate: Plate | None) -> None:
                loop.call_soon_threadsafe(self._told, kind, text, plate)

            self._client = PlateClient(self._endpoint, tell)
            self._client.start()

    def _leave(self, page: Page) -> None:
        self._pages.remove(page)
        if self._pages:
            wanted_elsewhere = set().union(*(other.wanted for other in self._pages))
            for finger in page.wanted.keys() - wanted_elsewhere:
                self._ask(page, Want(finger, None))
            if page.held:
                self._hold()
            return
        if self._hand is not None and page.held:
            self._hand.hold({})
        client, self._client = self._client, None
        self._last.clear()
        self._forget_plate()
        if client is not None:  # its farewell may take half a second: not on the loop
            task = asyncio.ensure_future(asyncio.to_thread(client.close))
            self._closing.add(task)
            task.add_done_callback(self._closing.discard)

    def _hear(self, page: Page, text: str) -> None:
        try:
            message = messages.read(text)
        except RequestError as error:
            page.tell("refused", messages.refused(str(error)))
            return
        if isinstance(message, Hold):
            page.held = message.points_mm
            self._hold()
        else:
            self._ask(page, message)

    def _ask(self, page: Page, wish: Want | ClearFault) -> None:
        if isinstance(wish, Want):
            page.remember(wish)
        if self._client is None:
            return
        loop = asyncio.get_running_loop()

        def refuse(text: str) -> None:
            loop.call_soon_threadsafe(page.tell, "refused", text)

        self._client.ask(wish, refuse)

    def _hold(self) -> None:
        """All fingers of all pages, each page's under names of its own."""
        if self._hand is None:
            return
        held = {f"{page.number}-{name}"[:32]: place for page in self._pages for name, place in page.held.items()}
        self._hand.hold(dict(list(held.items())[:MAX_HANDS]))

    # --- the daemon's news ---

    def _told(self, kind: str, text: str, plate: Plate | None) -> None:
        if self._client is None:
            return  # said by one that is being closed
        if kind == "gone":
            self._last.clear()
            self._forget_plate()
        if plate is not None:
            self._last.pop("gone", None)
            self._forget_plate()
            self._plate = plate
            self._hand = None if plate.rig_dir is None else PadHand(self._context, plate.rig_dir)
        self._last[kind] = text
        for page in self._pages:
            page.tell(kind, text)

    def _forget_plate(self) -> None:
        self._plate = None
        if self._hand is not None:
            self._hand.close()
            self._hand = None

    async def _close(self, _: web.Application) -> None:
        client, self._client = self._client, None
        for page in tuple(self._pages):
            await page.socket.close()
        if client is not None:  # its pages leave later, perhaps too late
            await asyncio.to_thread(client.close)
        if self._closing:
            await asyncio.gather(*self._closing)
        self._context.destroy(linger=0)


async def _file(name: str, _: web.Request) -> web.StreamResponse:
    data = resources.files(__package__).joinpath("page", name).read_bytes()
    return web.Response(body=data, content_type=TYPES[name.rpartition(".")[2]], charset="utf-8")
