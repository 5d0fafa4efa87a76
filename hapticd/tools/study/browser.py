"""Panel in a browser: a page with big buttons, served on this machine alone during a session.

Only this page is admitted: its address has a secret, the Host must be this server (against DNS rebinding), and a press
must have this server's Origin. Nothing is loaded from other hosts.
"""

from __future__ import annotations

import queue
import secrets
import socket
from collections.abc import Awaitable, Callable
from importlib import resources
from typing import TYPE_CHECKING, Annotated, Any

from msgspec import Meta

from ...errors import RequestError, missing_library
from ...wire.client import read
from ..web import guard
from .experiment import StudyError
from .panel import Screen

if TYPE_CHECKING:
    from aiohttp import web

ADDRESS = "127.0.0.1"
MAX_PRESS_BYTES = 256
ScreenNumber = Annotated[int, Meta(ge=0, le=2**31 - 1)]  # of a screen
TYPES = {"page.html": "text/html", "page.css": "text/css", "page.js": "text/javascript"}

_Handler = Callable[["web.Request"], Awaitable["web.StreamResponse"]]


class Browser:
    """Context manager that serves the page from its own thread at `url`. Port 0: any free one.

    Raises HapticdError without aiohttp, StudyError for a port in use.
    """

    def __init__(self, port: int = 0) -> None:
        self._web = _aiohttp_web()
        self._port = port
        self._secret = secrets.token_urlsafe(12)
        # Screen and number, replaced together: a press on an earlier screen is ignored.
        self._shown = (0, Screen("One moment", "The session is about to begin."))
        self._note = ""
        self._presses: queue.SimpleQueue[tuple[int, str]] = queue.SimpleQueue()

    @property
    def url(self) -> str:
        """The page's address, with its secret."""
        return f"http://{ADDRESS}:{self._port}/{self._secret}/"

    def __enter__(self) -> Browser:
        from ..web.serving import ServingThread

        try:
            listener = socket.create_server((ADDRESS, self._port))
        except OSError as error:
            raise StudyError(f"port {self._port}: cannot be bound ({error.strerror}): choose another.") from None
        self._port = listener.getsockname()[1]
        self._serving = ServingThread(self._runner(), listener, "study page")
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

    def _runner(self) -> web.AppRunner:
        from ..web import connections

        application = self._web.Application(client_max_size=MAX_PRESS_BYTES)
        root = f"/{self._secret}"
        application.router.add_get(f"{root}/", self._guarded(self._page))
        application.router.add_get(f"{root}/{{name}}", self._guarded(self._page))
        application.router.add_get(f"{root}/now/screen", self._guarded(self._now))
        application.router.add_post(f"{root}/press", self._guarded(self._press))
        runner: web.AppRunner = self._web.AppRunner(application, access_log=None, logger=connections.logger())
        return runner

    def _guarded(self, handler: _Handler) -> _Handler:
        """Return the handler, restricted to requests of this server's own page."""
        from ..web.connections import know

        async def guarded(request: web.Request) -> web.StreamResponse:
            if why := guard.refusal(self._port, request.headers, needs_origin=request.method == "POST"):
                raise self._web.HTTPForbidden(text=why)
            know(request)
            response = await handler(request)
            response.headers.update(guard.headers(self._port))
            return response

        return guarded

    async def _page(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info.get("name", "page.html")
        if name not in TYPES:
            raise self._web.HTTPNotFound
        text = resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
        response: web.StreamResponse = self._web.Response(text=text, content_type=TYPES[name])
        return response

    async def _now(self, _: web.Request) -> web.StreamResponse:
        number, screen = self._shown
        response: web.StreamResponse = self._web.json_response(
            {
                "number": number,
                "heading": screen.heading,
                "text": screen.text,
                "keys": [key._asdict() for key in screen.keys],
                "note": self._note,
            }
        )
        return response

    async def _press(self, request: web.Request) -> web.StreamResponse:
        try:
            body = await request.json()
            number, key = read(body["number"], ScreenNumber), read(body["key"], str)
        except (ValueError, LookupError, TypeError, RecursionError, RequestError):
            raise self._web.HTTPBadRequest(text="A press is a screen's number and a key.") from None
        self._presses.put((number, key))
        response: web.StreamResponse = self._web.json_response({})
        return response


def _aiohttp_web() -> Any:
    try:
        from aiohttp import web
    except ImportError:
        raise missing_library("The page needs aiohttp", "study") from None
    return web
