"""Panel in a browser: a page with big buttons, served on this machine alone during a session.

Only this page is admitted: its address ends with a key, the Host must be this server (against DNS rebinding), and a
press must have this server's Origin. Nothing is loaded from other hosts.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import queue
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Coroutine
from importlib import resources
from typing import Annotated, Any, Self

import msgspec
from aiohttp import web

from .experiment import StudyError
from .panel import Screen

ADDRESS = "127.0.0.1"
FILES = {"/": ("index.html", "text/html"), "/study.css": ("study.css", "text/css")} | {
    "/study.js": ("study.js", "text/javascript")
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
MAX_PRESS_BYTES = 256
WITHIN_S = 10.0

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Press(msgspec.Struct, frozen=True):
    """A key of a screen."""

    number: Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
    key: str


class Browser:
    """Context manager that serves the page from its own thread at `url`. Port 0: any free one.

    Raises StudyError for a port in use.
    """

    def __init__(self, port: int = 0) -> None:
        try:
            self._listener = socket.create_server((ADDRESS, port))
        except (OSError, OverflowError) as error:
            raise StudyError(f"--page-port: {port} cannot be bound ({error}): choose another one.") from None
        self._host = f"{ADDRESS}:{self._listener.getsockname()[1]}"
        self._key = secrets.token_urlsafe(12)
        self.url = f"http://{self._host}/?key={self._key}"
        # Screen and number, replaced together: a press on an earlier screen is ignored.
        self._shown = (0, Screen("One moment", "The session is about to begin."))
        self._note = ""
        self._presses: queue.SimpleQueue[Press] = queue.SimpleQueue()
        logging.getLogger("aiohttp.server").disabled = True  # a malformed request has a 400, not a traceback
        app = web.Application(client_max_size=MAX_PRESS_BYTES, middlewares=[self._guarded])
        for path in FILES:
            app.router.add_get(path, _file)
        app.router.add_get("/screen", self._screen)
        app.router.add_post("/press", self._press)
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="study page", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._wait_for(self._serve())
        return self

    def __exit__(self, *_: object) -> None:
        self._wait_for(self._runner.cleanup())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def show(self, screen: Screen) -> None:
        number, before = self._shown
        if screen != before:
            self._shown, self._note = (number + 1, screen), ""

    def note(self, text: str) -> None:
        self._note = text

    def pressed(self) -> str | None:
        while not self._presses.empty():
            press = self._presses.get()
            number, screen = self._shown
            if press.number == number and press.key in [one.name for one in screen.keys]:
                return press.key
        return None

    def _wait_for(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(WITHIN_S)

    async def _serve(self) -> None:
        await self._runner.setup()
        await web.SockSite(self._runner, self._listener).start()

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        is_page = request.path.endswith((".css", ".js"))  # which send no key, and hold nothing of the session
        has_key = hmac.compare_digest(request.query.get("key", "").encode(), self._key.encode())
        origin = request.headers.get("Origin", "" if request.method == "POST" else f"http://{self._host}")
        if request.headers.get("Host") != self._host or origin != f"http://{self._host}" or not (is_page or has_key):
            text = "Open the address that the study printed: it ends with a key.\n"
            return web.Response(status=403, text=text, headers=HEADERS)
        response = await handler(request)
        response.headers.update(HEADERS)
        return response

    async def _screen(self, _: web.Request) -> web.StreamResponse:
        number, screen = self._shown
        keys = [key._asdict() for key in screen.keys]
        shown = {"number": number, "heading": screen.heading, "text": screen.text, "keys": keys, "note": self._note}
        return web.json_response(shown)

    async def _press(self, request: web.Request) -> web.StreamResponse:
        try:
            self._presses.put(msgspec.json.decode(await request.read(), type=Press))
        except (msgspec.DecodeError, RecursionError):
            raise web.HTTPBadRequest(text="A press is a screen's number and a key.") from None
        return web.json_response({})


async def _file(request: web.Request) -> web.StreamResponse:
    name, kind = FILES[request.path]
    data = resources.files(__package__).joinpath("page", name).read_bytes()
    return web.Response(body=data, content_type=kind, charset="utf-8")
