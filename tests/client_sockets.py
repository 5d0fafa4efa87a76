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
from asynchronous import PATIENCE_S, until

from hapticd.io.clients.server import ClientServer

GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\x00") + bytes(32)


@dataclass
class Served:
    """A running server, the messages it received, and the user of each."""

    server: ClientServer
    messages: list[bytes] = field(default_factory=list)
    users: list[str] = field(default_factory=list)

    def on_message(self, payload: bytes, user: str) -> None:
        self.messages.append(payload)
        self.users.append(user)

    async def until(self, condition: Callable[[], bool]) -> None:
        """Sweep the server, as the daemon does at each tick, until it holds."""
        await until(condition, self.server.sweep)


@asynccontextmanager
async def served(directory: Path) -> AsyncIterator[Served]:
    running = Served(ClientServer(directory))
    loop, refusal = asyncio.get_running_loop(), b"one part, please"
    running.server.start(loop, running.on_message, lambda payload, _: b"answer to " + payload, refusal_of_parts=refusal)
    try:
        yield running
    finally:
        running.server.close()


@contextmanager
def connected(directory: Path, kind: int, name: str, **options: Any) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(kind) as client:
        client.linger, client.rcvtimeo = 0, int(1000 * PATIENCE_S)
        for option, value in options.items():
            setattr(client, option, value)
        client.connect(f"ipc://{directory / name}")
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
