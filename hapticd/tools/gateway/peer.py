"""One WebSocket: a client of the daemon with sockets and a name of its own."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import Any, Final

import zmq
import zmq.asyncio
from aiohttp import WSMsgType, web

from hapticd_client.endpoint import Endpoint
from hapticd_contract.requests import Request
from hapticd_contract.targets import TargetsMessage
from hapticd_contract.web import Follow

from ...io.clients.senders import BURST, RATE_HZ
from ..web.connections import Pace
from . import messages
from .feed import STATES, Feed
from .messages import RefusedMessage

MAX_REQUESTS: Final = 8  # that wait, as at the daemon
ANSWER_S: Final = 2.0  # within which a daemon takes a request
FLUSH_MS: Final = 200  # for what a closing peer sent last
SHARE: Final = 0.9  # of the daemon's rate limit, which counts a process and not its WebSockets
MAX_UNREAD_BYTES: Final = 256 * 1024  # of replies, as the daemon has it


class Turns:
    """The rate at which all peers together send to one socket of the daemon, each in turn."""

    def __init__(self) -> None:
        self._pace = Pace(SHARE * RATE_HZ, int(SHARE * BURST))
        self._lock = asyncio.Lock()  # serves in order of arrival, and a peer waits here once

    async def wait(self) -> None:
        """Return when it is the caller's turn."""
        async with self._lock:
            await self._pace.wait()


class Names:
    """Which peer has a client's name. Each has one, so that no page speaks for another."""

    def __init__(self) -> None:
        self._names: dict[str, int] = {}

    def claim(self, number: int, name: str) -> str:
        """Return why a peer may not use a name, "" if it may."""
        own = next((known for known, holder in self._names.items() if holder == number), name)
        if own != name:
            return f"client: this connection is {own!r}: open another one for a second client."
        if self._names.setdefault(name, number) != number:
            return f"client: {name!r} is the name of another connection: choose another."
        return ""

    def release(self, number: int) -> None:
        """Free a peer's name."""
        self._names = {name: holder for name, holder in self._names.items() if holder != number}


class Outbox:
    """What waits for one WebSocket to be sent: replies in their order, and the newest states."""

    def __init__(self) -> None:
        self.is_overfull = False
        self._replies: deque[str] = deque()
        self._states: deque[str] = deque(maxlen=STATES)
        self._unread_bytes = 0
        self._ready = asyncio.Event()

    def reply(self, text: str) -> None:
        """Queue a reply; a peer that leaves too many unread is to be disconnected (`is_overfull`)."""
        self._unread_bytes += len(text)
        self.is_overfull = self._unread_bytes > MAX_UNREAD_BYTES
        self._replies.append(text)
        self._ready.set()

    def state(self, text: str, *, newest: bool) -> None:
        """Queue a state: instead of those that wait with `newest`, else behind them; the oldest gives way."""
        if newest:
            self._states.clear()
        self._states.append(text)
        self._ready.set()

    async def write(self, socket: web.WebSocketResponse) -> None:
        """Send what is queued until the socket is closed or what is queued is too much."""
        while not socket.closed and not self.is_overfull:
            await self._ready.wait()
            self._ready.clear()
            while (self._replies or self._states) and not self.is_overfull:
                text = self._next()
                await socket.send_str(text)

    def _next(self) -> str:
        if not self._replies:
            return self._states.popleft()
        text = self._replies.popleft()
        self._unread_bytes -= len(text)
        return text


class Peer:
    """Relays between one WebSocket and the daemon until either side of the WebSocket closes it."""

    def __init__(self, number: int, context: zmq.asyncio.Context, endpoint: Endpoint, feed: Feed, names: Names) -> None:
        self._number = number
        self._endpoint = endpoint
        self._feed = feed
        self._names = names
        self._outbox = Outbox()
        self._targets_socket = connected(context, zmq.PUSH, endpoint, "targets")
        self._control_socket = connected(context, zmq.DEALER, endpoint, "control")
        self._targets: tuple[bytes, float] | None = None  # the newest that waits, and until when it holds
        self._requests: deque[tuple[int, bytes]] = deque()
        self._has_targets, self._has_requests = asyncio.Event(), asyncio.Event()

    async def relay(self, socket: web.WebSocketResponse, targets: Turns, requests: Turns) -> None:
        """Return when the WebSocket is closed."""
        loops = (self._reads(socket), self._outbox.write(socket), self._replies())
        tasks = [asyncio.ensure_future(one) for one in (*loops, self._sends_targets(targets), self._asks(requests))]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._feed.leave(self._number)
            self._names.release(self._number)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._flush()
            self._targets_socket.close(linger=FLUSH_MS)
            self._control_socket.close(linger=FLUSH_MS)

    # --- from the WebSocket ---

    async def _reads(self, socket: web.WebSocketResponse) -> None:
        pace = Pace(RATE_HZ, BURST)
        async for message in socket:
            if message.type is WSMsgType.TEXT:
                try:
                    self._take(messages.decode(message.data))
                except RefusedMessage as error:
                    self._outbox.reply(messages.refusal(str(error), error.request_id))
            else:
                self._outbox.reply(messages.refusal("A message is a JSON text, this one is binary."))
            await pace.wait()

    def _take(self, message: messages.Received) -> None:
        if isinstance(message, Follow):
            self._follow(message.states)
            return
        payload, name = messages.encode(message), messages.client_of(message)
        why = "" if name is None else self._names.claim(self._number, name)
        if isinstance(message, TargetsMessage):
            if why:
                raise RefusedMessage(why)
            self._targets = payload, _now_s() + message.ttl_s
            self._has_targets.set()
            return
        if not why and len(self._requests) >= MAX_REQUESTS:
            why = f"{MAX_REQUESTS} requests of this connection wait already: await replies first."
        if why:
            raise RefusedMessage(why, message.id)
        self._queue(message, payload)

    def _queue(self, request: Request, payload: bytes) -> None:
        self._requests.append((request.id, payload))
        self._has_requests.set()

    def _follow(self, states: str) -> None:
        self._feed.leave(self._number)
        if states != "none":
            self._feed.follow(self._number, lambda text: self._outbox.state(text, newest=states == "newest"))

    # --- to the daemon ---

    async def _sends_targets(self, turns: Turns) -> None:
        while True:
            await self._has_targets.wait()
            await turns.wait()
            await _is_writable(self._targets_socket)
            self._flush()

    def _flush(self) -> None:
        """Send the newest targets, if they still hold."""
        waiting, self._targets = self._targets, None
        self._has_targets.clear()
        if waiting is not None and _now_s() < waiting[1]:
            with contextlib.suppress(zmq.ZMQError):
                zmq.Socket.send(self._targets_socket, waiting[0], zmq.NOBLOCK)

    async def _asks(self, turns: Turns) -> None:
        while True:
            await self._has_requests.wait()
            await turns.wait()
            has_daemon = await _is_writable(self._control_socket, int(ANSWER_S * 1000))
            request_id, payload = self._requests.popleft()
            if not self._requests:
                self._has_requests.clear()
            if has_daemon:
                await self._control_socket.send(payload)
            else:
                sentence = f"No hapticd answers at {self._endpoint}: start one, then try again."
                self._outbox.reply(messages.refusal(sentence, request_id))

    async def _replies(self) -> None:
        while True:
            self._outbox.reply(messages.text_of(await self._control_socket.recv()))


def connected(context: zmq.asyncio.Context, kind: int, endpoint: Endpoint, name: str) -> zmq.asyncio.Socket:
    """Return a socket to the daemon's of this name, which queues nothing without one."""
    socket = context.socket(kind)
    socket.linger = 0
    socket.immediate = True
    endpoint.connect(socket, name)
    return socket


async def _is_writable(socket: zmq.asyncio.Socket, timeout_ms: int | None = None) -> bool:
    """Wait for a daemon; return whether there is one."""
    poll: Any = socket.poll  # pyzmq's types leave out the second argument
    return bool(await poll(timeout_ms, zmq.POLLOUT))


def _now_s() -> float:
    return asyncio.get_running_loop().time()
