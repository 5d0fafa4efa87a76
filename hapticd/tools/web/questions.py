"""One page for the person who answers a command: it shows what the command tells it, and returns what is pressed there.

The command works on a thread of its own, and sees there at any time whether the page is open.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from typing import TypeVar

import msgspec
from aiohttp import WSMessage, WSMsgType, web

from ...errors import HapticdError
from .application import HOSTS, add_page, application
from .serving import bound, in_browser, served
from .sockets import Outbox, Pace, opened, read, until_one_ends

MAX_KEY_BYTES = 64
_Result = TypeVar("_Result")


class QuestionPage:
    """The page of `package`, which connects to /socket, of `hapticd COMMAND`; all but `serve` is for its thread."""

    def __init__(self, package: str, command: str) -> None:
        self._package, self._command = package, command
        self._key = secrets.token_urlsafe(16)
        self._sockets: list[web.WebSocketResponse] = []
        self._outbox = Outbox(1)
        self._shown, self._pressed = "{}", ""
        self._has_ended = False

    async def serve(self, work: Callable[[], _Result]) -> _Result:
        """Serve while `work` runs on a thread; return its result. Raises HapticdError."""
        self._loop = asyncio.get_running_loop()
        app = application(self._command, self._key, keyed=("/", "/socket"))
        add_page(app, self._package)
        app.router.add_get("/socket", self._socket)
        listener = bound(HOSTS[0], 0)
        address = f"http://{HOSTS[0]}:{listener.getsockname()[1]}/?key={self._key}"
        async with served(app, listener):
            print(f"the page: {address}\n(Ctrl-C ends)", flush=True)
            working = asyncio.ensure_future(asyncio.to_thread(work))
            try:
                async with in_browser(address):
                    return await working
            finally:
                self._has_ended = True

    @property
    def is_open(self) -> bool:
        """Whether the page is open, and not hidden."""
        return bool(self._sockets)

    def show(self, **message: object) -> None:
        """Show a message from now on; what was pressed before counts no more."""
        self._shown, self._pressed = msgspec.json.encode(message).decode(), ""
        self._loop.call_soon_threadsafe(self._outbox.newest, "shown", self._shown)

    def pressed(self) -> str:
        """Return the last key since the call before, "" without one. Raises HapticdError once the server has ended."""
        if self._has_ended:
            raise HapticdError("The page has ended before the last answer: nothing is changed.")
        key, self._pressed = self._pressed, ""
        return key

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        socket = await opened(request, MAX_KEY_BYTES, self._sockets, 1, "pages")
        if not socket.closed:
            self._sockets.append(socket)
            self._outbox.newest("shown", self._shown)
            try:
                await until_one_ends(read(socket, Pace(), self._take), self._outbox.write(socket))
            finally:
                self._sockets.remove(socket)
        return socket

    def _take(self, message: WSMessage) -> None:
        if message.type is WSMsgType.TEXT:
            self._pressed = message.data
