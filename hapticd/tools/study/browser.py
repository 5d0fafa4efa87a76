"""Panel in a browser: a page with big buttons, served on this machine alone during a session.

Only this page is admitted: its address ends with a key, the Host must be this server (against DNS rebinding), and a
press must have this server's Origin. Nothing is loaded from other hosts.
"""

from __future__ import annotations

import queue
import secrets
from typing import Annotated

from aiohttp import web
from msgspec import Meta

from ...errors import RequestError
from ...wire.client import read
from ..web.application import add_page, application
from ..web.serving import ServingThread, bound
from .panel import Screen

ADDRESS = "127.0.0.1"
KEYED = ("/", "/screen", "/press")
MAX_PRESS_BYTES = 256
ScreenNumber = Annotated[int, Meta(ge=0, le=2**31 - 1)]  # of a screen


class Browser:
    """Context manager that serves the page from its own thread at `url`. Port 0: any free one.

    Raises HapticdError for a port in use.
    """

    def __init__(self, port: int = 0) -> None:
        listener = bound(ADDRESS, port, "--page-port")
        key = secrets.token_urlsafe(12)
        self.url = f"http://{ADDRESS}:{listener.getsockname()[1]}/?key={key}"  # with its key
        # Screen and number, replaced together: a press on an earlier screen is ignored.
        self._shown = (0, Screen("One moment", "The session is about to begin."))
        self._note = ""
        self._presses: queue.SimpleQueue[tuple[int, str]] = queue.SimpleQueue()
        app = application("study", key, keyed=KEYED, max_bytes=MAX_PRESS_BYTES)
        add_page(app, __package__)
        app.router.add_get("/screen", self._screen)
        app.router.add_post("/press", self._press)
        self._serving = ServingThread(app, listener, "study page")

    def __enter__(self) -> Browser:
        self._serving.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._serving.__exit__()

    def show(self, screen: Screen) -> None:
        number, before = self._shown
        if screen != before:
            self._shown, self._note = (number + 1, screen), ""

    def note(self, text: str) -> None:
        self._note = text

    def pressed(self) -> str | None:
        while not self._presses.empty():
            pressed_on, key = self._presses.get()
            number, screen = self._shown
            if pressed_on == number and key in [one.name for one in screen.keys]:
                return key
        return None

    async def _screen(self, _: web.Request) -> web.StreamResponse:
        number, screen = self._shown
        return web.json_response(
            {
                "number": number,
                "heading": screen.heading,
                "text": screen.text,
                "keys": [key._asdict() for key in screen.keys],
                "note": self._note,
            }
        )

    async def _press(self, request: web.Request) -> web.StreamResponse:
        try:
            body = await request.json()
            number, key = read(body["number"], ScreenNumber), read(body["key"], str)
        except (ValueError, LookupError, TypeError, RecursionError, RequestError):
            raise web.HTTPBadRequest(text="A press is a screen's number and a key.") from None
        self._presses.put((number, key))
        return web.json_response({})
