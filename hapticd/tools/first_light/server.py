"""HTTP server of the page, on this computer alone, from a thread of its own.

/            the page; needs the key       /socket    documents out, presses in (page_front.py); needs the key
/<file>      its style and script

One page at a time. It says all the time that it lives; when it is closed, or silent, `on_gone` is called.
"""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Callable

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web

from ..web.application import add_page, application
from ..web.serving import ServingThread
from ..web.sockets import Pace
from .page_front import Press

KEYED = ("/", "/socket")
ALIVE_WITHIN_S = 3.0  # a page in the background says it once a second
MAX_MESSAGE_BYTES = 512
BUSY = "The page is open in another window already: close that one."


class PageServer:
    """Context in which the page is served at `address`. The callbacks are called from its thread."""

    def __init__(self, listener: socket.socket, on_press: Callable[[Press], None], on_gone: Callable[[], None]) -> None:
        host, port = listener.getsockname()
        key = secrets.token_urlsafe(16)
        self._on_press, self._on_gone = on_press, on_gone
        self._newest = ""
        self._writing: set[asyncio.Task[None]] = set()
        self._page: web.WebSocketResponse | None = None
        self.address = f"http://{host}:{port}/?key={key}"
        app = application("first-light", key, keyed=KEYED)
        add_page(app, __package__)
        app.router.add_get("/socket", self._socket)
        app.on_shutdown.append(self._close)
        self._serving = ServingThread(app, listener, "first-light page")

    def __enter__(self) -> PageServer:
        self._serving.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._serving.__exit__()

    def publish(self, text: str) -> None:
        """Send a document to the open page, and to each that opens later."""
        self._serving.call_soon(self._send, text)

    def _send(self, text: str) -> None:
        self._newest = text
        if self._page is not None:
            writing = asyncio.get_running_loop().create_task(self._write(self._page, text))
            self._writing.add(writing)
            writing.add_done_callback(self._writing.discard)

    async def _write(self, page: web.WebSocketResponse, text: str) -> None:
        try:
            await page.send_str(text)
        except (ConnectionError, RuntimeError):  # it closes; its reader says so
            return

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        page = web.WebSocketResponse(max_msg_size=MAX_MESSAGE_BYTES)
        await page.prepare(request)
        if self._page is not None:
            await page.close(code=WSCloseCode.TRY_AGAIN_LATER, message=BUSY.encode())
            return page
        self._page = page
        try:
            if self._newest:
                await page.send_str(self._newest)
            await self._read(page)
        finally:
            self._page = None
            self._on_gone()
        return page

    async def _read(self, page: web.WebSocketResponse) -> None:
        """Take presses until the page closes, or is silent for too long."""
        pace = Pace()
        while True:
            try:
                message = await page.receive(timeout=ALIVE_WITHIN_S)
            except TimeoutError:
                await page.close()
                return
            if message.type is not WSMsgType.TEXT:
                return
            try:
                press = msgspec.json.decode(message.data, type=Press)
            except (msgspec.DecodeError, RecursionError):
                continue
            if press.button:
                self._on_press(press)
            await pace.wait()

    async def _close(self, _: web.Application) -> None:
        if self._page is not None:
            await self._page.close()
