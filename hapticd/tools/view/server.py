"""HTTP server of the page, with a websocket per open page, on one asyncio loop; the client has its own thread.

/            the page; needs the key       /shapes           the plate's mode shapes, float32
/<file>      its styles and scripts        /socket           frames out, simulated fingers in (messages.py)
/client      a WebSocket of the gateway: the client protocol as JSON (../gateway), for the page's requests too
"""

from __future__ import annotations

import asyncio
import os
import secrets
import sysconfig
from functools import partial
from pathlib import Path

import zmq
from aiohttp import WSMessage, WSMsgType, web

from hapticd_client.endpoint import find
from hapticd_contract.simulated import MAX_TOUCHES, SimulatedTouch

from ...errors import CHECKOUT, RequestError
from ..gateway.server import PATH, Gateway
from ..web.application import add_page, application
from ..web.sockets import Outbox, Pace, opened, read, until_one_ends
from . import messages
from .client import PagePlate, PlateClient
from .messages import Hold
from .recording import PageRecording
from .rig import PadSender

KEYED = ("/", "/shapes", "/socket", PATH)  # all but the page's own files
INSTALLED = Path(sysconfig.get_path("data"), "share", "hapticd", "javascript")
CLIENT_LIBRARY = (INSTALLED if INSTALLED.is_dir() else CHECKOUT / "clients" / "javascript") / "hapticd.js"
MAX_PAGES = 8
MAX_KINDS = 16  # of messages to a page


class Page:
    """One open page: its queued messages, and the fingers that it holds on the pad."""

    def __init__(self, socket: web.WebSocketResponse, number: int) -> None:
        self.socket = socket
        self.number = number
        self.held: dict[str, SimulatedTouch] = {}
        self.outbox = Outbox(MAX_KINDS)

    def send(self, kind: str, text: str) -> None:
        """Queue a message; it replaces an unsent one of the same kind."""
        self.outbox.newest(kind, text)


class Viewer:
    """All open pages, and the client that they share. `starting` describes a simulated plate whose service starts."""

    def __init__(self, endpoint: str | None, key: str | None = None, starting: str = "") -> None:
        self.key = secrets.token_urlsafe(16) if key is None else key
        self._endpoint = endpoint
        self._pages: list[Page] = []
        self._opened = 0
        self._client: PlateClient | None = None
        self._plate: PagePlate | None = None
        self._last = {"starting": messages.sentence("starting", f"Starting: {starting} …")} if starting else {}
        self._context = zmq.Context()
        self._pad: PadSender | None = None
        self._closing: set[asyncio.Task[None]] = set()
        self._recorded = ""  # the last message of a recording
        self._recording = PageRecording(endpoint, self._publish_recording)

    def app(self) -> web.Application:
        """The web application."""
        app = application("view", self.key, keyed=KEYED)
        add_page(app, __package__)
        app.router.add_get("/shapes", self._shapes)
        app.router.add_get("/socket", self._socket)
        app.on_shutdown.append(self._close)
        app.router.add_get("/hapticd.js", self._client_library)
        Gateway(partial(find, self._endpoint, os.environ)).add_to(app)
        return app

    # --- responses ---

    async def _shapes(self, _: web.Request) -> web.StreamResponse:
        if self._plate is None:
            raise web.HTTPNotFound(text="The daemon has not described its plate yet.\n")
        return web.Response(body=self._plate.grid, content_type="application/octet-stream")

    async def _client_library(self, _: web.Request) -> web.StreamResponse:
        return web.Response(body=CLIENT_LIBRARY.read_bytes(), content_type="text/javascript", charset="utf-8")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        socket = await opened(request, messages.MAX_MESSAGE_BYTES, self._pages, MAX_PAGES, "pages")
        if not socket.closed:
            self._opened += 1
            page = Page(socket, self._opened)
            self._enter(page)
            try:
                await until_one_ends(read(socket, Pace(), partial(self._receive, page)), page.outbox.write(socket))
            finally:
                self._leave(page)
        return socket

    # --- pages ---

    def _enter(self, page: Page) -> None:
        for kind, text in self._last.items():
            page.send(kind, text)
        if self._recording.is_on:
            page.send("recording", self._recorded)
        self._pages.append(page)
        if self._client is None:
            self._connect()

    def _connect(self) -> None:
        loop = asyncio.get_running_loop()

        def publish(kind: str, text: str, plate: PagePlate | None) -> None:
            loop.call_soon_threadsafe(self._publish, kind, text, plate)

        self._client = PlateClient(self._endpoint, publish)
        self._client.start()

    def _leave(self, page: Page) -> None:
        self._pages.remove(page)
        if self._pages:
            if page.held:
                self._hold()
            return
        if self._pad is not None and page.held:
            self._pad.hold({})
        client, self._client = self._client, None
        self._clear_plate()
        if client is not None:  # disconnecting may take half a second: not on the loop
            task = asyncio.ensure_future(asyncio.to_thread(client.close))
            self._closing.add(task)
            task.add_done_callback(self._closing.discard)

    def _receive(self, page: Page, received: WSMessage) -> None:
        if received.type is not WSMsgType.TEXT:
            return
        try:
            message = messages.decode(received.data)
        except RequestError as error:
            page.send("refused", messages.sentence("refused", str(error)))
            return
        if isinstance(message, Hold):
            page.held = message.touches
            self._hold()
        else:
            self._recording.request(is_on=message.is_on)

    def _hold(self) -> None:
        """Send the fingers of all pages, with names that are unique per page."""
        if self._pad is None:
            return
        held = {f"{page.number}-{name}"[:32]: touch for page in self._pages for name, touch in page.held.items()}
        self._pad.hold(dict(list(held.items())[:MAX_TOUCHES]))

    def _publish_recording(self, text: str) -> None:
        self._recorded = text
        for page in self._pages:
            page.send("recording", text)

    # --- messages of the client ---

    def _publish(self, kind: str, text: str, plate: PagePlate | None) -> None:
        if self._client is None:
            return  # from a client that is being closed
        if kind == "gone":
            if "starting" in self._last:
                return  # the service does not answer yet; the viewer ends with it
            self._clear_plate()
        if plate is not None:
            self._last.pop("gone", None)
            self._last.pop("starting", None)
            self._clear_plate()
            self._plate = plate
            self._pad = None if plate.rig_dir is None else PadSender(self._context, plate.rig_dir)
        self._last[kind] = text
        for page in self._pages:
            page.send(kind, text)

    def _clear_plate(self) -> None:
        """Forget the plate and all messages about it, but not that one is starting."""
        self._last = {kind: text for kind, text in self._last.items() if kind == "starting"}
        self._plate = None
        if self._pad is not None:
            self._pad.close()
            self._pad = None

    async def _close(self, _: web.Application) -> None:
        for page in tuple(self._pages):
            await page.socket.close()
        await self._recording.close()
        client, self._client = self._client, None
        if client is not None:  # its pages close later, perhaps too late
            await asyncio.to_thread(client.close)
        if self._closing:
            await asyncio.gather(*self._closing)
        self._context.destroy(linger=0)
