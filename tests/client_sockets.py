"""Clients of a `ClientServer` in the same process: ZeroMQ's own, and raw ones that speak any ZMTP 3.0."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
import zmq.auth
from asynchronous import PATIENCE_S, until
from free_ports import free_ports

from hapticd.io.clients import keys
from hapticd.io.clients.inbox import Inbox
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.sockets import ENDPOINTS, Remote

GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\x00") + bytes(32)


@dataclass
class Served:
    """A running server, the messages it received, and the user of each."""

    server: ClientServer
    messages: list[bytes] = field(default_factory=list)
    users: list[str] = field(default_factory=list)
    requests: list[bytes] = field(default_factory=list)
    waited_ns: list[int] = field(default_factory=list)

    @property
    def inboxes(self) -> list[Inbox]:
        """Those of all connections to `targets` and `control`, the oldest first."""
        return list(self.server._inboxes.values())

    def on_message(self, payload: bytes, user: str, waited_ns: int) -> None:
        self.messages.append(payload)
        self.users.append(user)
        self.waited_ns.append(waited_ns)

    def on_request(self, payload: bytes, _user: str, waited_ns: int) -> bytes:
        self.requests.append(payload)
        self.waited_ns.append(waited_ns)
        return b"answer to " + payload

    def hold(self) -> None:
        """Handle nothing until `resume`."""
        if self.server._break is not None:
            self.server._break.cancel()
        self.server._break = asyncio.get_running_loop().call_later(PATIENCE_S, lambda: None)

    def resume(self) -> None:
        """Handle what waits; `waiting` may have consumed the edge of a socket that the server has not seen yet."""
        self.server._break = None
        self.server.sweep()

    def waiting(self) -> list[bytes]:
        """Read what has come; return what waits to be handled."""
        return [message.frames[-1].bytes for box in self.inboxes if box.read(b"") for message in box._waiting]

    async def until(self, condition: Callable[[], bool]) -> None:
        """Sweep the server, as the daemon does at each tick, until it holds."""
        await until(condition, self.server.sweep)


@asynccontextmanager
async def served(directory: Path, remote: Remote | None = None) -> AsyncIterator[Served]:
    running = Served(ClientServer(directory, remote))
    loop, refusal = asyncio.get_running_loop(), b"one part, please"
    running.server.start(loop, running.on_message, running.on_request, refusal_of_parts=refusal)
    try:
        yield running
    finally:
        running.server.close()


def secured(folder: Path) -> tuple[Remote, dict[str, bytes]]:
    """A server's TCP endpoint, and the options of a client that it allows."""
    own, other = keys.make_pair(folder, "hapticd"), keys.make_pair(folder, "ann")
    keys.allow(folder, other[0])
    public, secret = zmq.auth.load_certificate(other[1])
    assert secret is not None
    options = {"curve_serverkey": zmq.auth.load_certificate(own[0])[0], "curve_publickey": public}
    return Remote("127.0.0.1", free_ports(), keys.load(folder)), {**options, "curve_secretkey": secret}


@contextmanager
def connected(
    directory: Path, kind: int, name: str, remote: Remote | None = None, **options: Any
) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(kind) as client:
        client.linger, client.rcvtimeo = 0, int(1000 * PATIENCE_S)
        for option, value in options.items():
            setattr(client, option, value)
        at = None if remote is None else f"tcp://{remote.host}:{remote.port + list(ENDPOINTS).index(name)}"
        client.connect(at or f"ipc://{directory / name}")
        yield client


async def in_thread(function: Callable[[], Any]) -> Any:
    """Run a blocking client call in a thread."""
    return await asyncio.wait_for(asyncio.to_thread(function), PATIENCE_S)


# --- raw ---------------------------------------------------------------------------------------------------------


def frame(body: bytes, flags: int = 0) -> bytes:
    if len(body) > 255:
        return struct.pack(">BQ", flags | 2, len(body)) + body
    return bytes([flags, len(body)]) + body


def command(name: bytes, body: bytes = b"") -> bytes:
    return frame(bytes([len(name)]) + name + body, flags=4)


def ready(**properties: bytes) -> bytes:
    pairs = ((name.replace("_", "-").encode(), value) for name, value in properties.items())
    body = b"".join(bytes([len(name)]) + name + struct.pack(">I", len(value)) + value for name, value in pairs)
    return command(b"READY", body)


@contextmanager
def raw(path: Path, *data: bytes) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(PATIENCE_S)
        client.connect(str(path))
        client.sendall(b"".join(data))
        yield client


@asynccontextmanager
async def greeted(path: Path, *frames: bytes, **properties: bytes) -> AsyncIterator[socket.socket]:
    """A client that has sent these frames, as soon as its handshake allowed it, and reads nothing more."""
    with raw(path, GREETING) as client:
        left = len(GREETING)
        while left > 0:  # who goes on before has broken the protocol
            left -= len(await asyncio.to_thread(client.recv, left))
        await asyncio.to_thread(client.sendall, ready(**properties) + b"".join(frames))
        yield client
