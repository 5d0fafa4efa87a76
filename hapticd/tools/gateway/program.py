"""`hapticd gateway`: arguments, and the server process."""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import secrets
import socket
import stat
from functools import partial
from pathlib import Path

from ...errors import UsageError
from ...regular_file import opened, read_bounded
from ...wire.osc import require_package
from ..arguments import PORT_NUMBER, add_endpoint, runtime_directory

HOST = "127.0.0.1"
PORT = 8018
KEY = re.compile(r"[A-Za-z0-9_-]{16,128}")
ORIGIN = re.compile(r"null|https?://[A-Za-z0-9.\-]+(:\d{1,5})?")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_endpoint(parser, type=runtime_directory)
    parser.add_argument("--port", type=PORT_NUMBER, default=PORT, help=f"to listen on, 0: any (default {PORT})")
    parser.add_argument(
        "--origin",
        action="append",
        default=[],
        metavar="URL",
        help="of a page that may connect, as http://localhost:8000, or null for one opened as a file; repeatable "
        "(default: programs only, no page)",
    )
    parser.add_argument(
        "--key-file", type=Path, metavar="FILE", help="holds the key, and is made if missing (default: a new key)"
    )
    parser.add_argument(
        "--host",
        default=HOST,
        metavar="ADDRESS",
        help=f"of this computer, to listen on (default {HOST}; other computers can read what is sent on others)",
    )
    parser.add_argument(
        "--osc",
        type=PORT_NUMBER,
        metavar="PORT",
        help="take OSC messages, too, at this UDP port of 127.0.0.1, from every program here: OSC has no key",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Serve until SIGTERM or SIGINT. Raises HapticdError."""
    if options.osc is not None:
        require_package()
    for origin in options.origin:
        if not ORIGIN.fullmatch(origin):
            raise UsageError(f"--origin: {origin!r} is none: give scheme, host and port, as http://localhost:8000.")
    key = secrets.token_urlsafe(16) if options.key_file is None else _key(options.key_file)
    from ..web.serving import bound

    with bound(options.host, options.port) as listener:
        asyncio.run(_serve(listener, key, options))


def _key(path: Path) -> str:
    """Return the key in a file of this user's alone, which is made where there is none."""
    if not path.exists():
        with opened(path, mode=0o600) as file:
            file.write(secrets.token_urlsafe(16).encode() + b"\n")
    text = read_bounded(path, 1024).decode(errors="replace").strip()
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise UsageError(f"--key-file: other users may read {path}: run `chmod 600` on it, or make a new one.")
    if not KEY.fullmatch(text):
        raise UsageError(f"--key-file: {path} must hold one word of 16 .. 128 letters, digits, - and _.")
    return text


async def _serve(listener: socket.socket, key: str, options: argparse.Namespace) -> None:
    from hapticd_client.endpoint import find

    from ..web.application import HOSTS, application
    from ..web.serving import ended_by_signal, served
    from .server import Gateway

    names = HOSTS if options.host == HOST else (options.host, *HOSTS)
    app = application("gateway", key, hosts=names, origins=options.origin)
    gateway = Gateway(partial(find, options.endpoint, os.environ), options.osc)
    gateway.add_to(app)
    ended = ended_by_signal()
    async with served(app, listener):
        print(f"the gateway: ws://{options.host}:{listener.getsockname()[1]}/client?key={key}", flush=True)
        if gateway.osc_port is not None:
            print(f"OSC: udp://{HOST}:{gateway.osc_port}", flush=True)
        print("(Ctrl-C ends)", flush=True)
        await ended.wait()
