"""Serving an application on the running loop, and opening its page."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import sys
import tempfile
import webbrowser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from html import escape
from pathlib import Path

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from ...errors import HapticdError

END_WITHIN_S = 1.0
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


def bound(host: str, port: int) -> socket.socket:
    """Return a socket bound to an address of this computer, port 0: any. Raises HapticdError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise HapticdError(
            f"Port {port} cannot be bound ({error.strerror}): choose another with --port, or 0 for any."
        ) from None
    return listener


@asynccontextmanager
async def served(app: web.Application, listener: socket.socket) -> AsyncIterator[None]:
    """Serve at a listener, which is closed in the end."""
    log = logging.getLogger("aiohttp.server")  # a malformed request gets a 400, and no line
    log.addFilter(lambda record: not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError)))
    runner = web.AppRunner(app, access_log=None, logger=log, shutdown_timeout=END_WITHIN_S)
    await runner.setup()
    try:
        await web.SockSite(runner, listener).start()
        yield
    finally:
        await runner.cleanup()


def ended_by_signal() -> asyncio.Event:
    """Return an event that SIGTERM and SIGINT set."""
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    return ended


@asynccontextmanager
async def in_browser(address: str, *, is_wanted: bool = True) -> AsyncIterator[None]:
    """Context of a page that a browser is asked to open; not without a screen, where it could be one of the terminal.

    The browser gets a file that leads to `address`, readable by this user only: every user of the computer can read a
    command line, so it must not hold the key.
    """
    if not is_wanted or not (sys.platform == "darwin" or any(map(os.environ.get, SCREENS))):
        yield
        return
    with tempfile.TemporaryDirectory(prefix="hapticd-page-") as folder:
        file = Path(folder, "open.html")
        file.touch(mode=0o600)
        file.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={escape(address)}">\n')
        await asyncio.to_thread(webbrowser.open, file.as_uri())
        yield
