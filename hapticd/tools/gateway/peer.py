"""One WebSocket: a client of the daemon with sockets and a name of its own."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any, Final

import zmq
import zmq.asyncio
from aiohttp import WSMessage, WSMsgType, web

from hapticd_contract.requests import Request
from hapticd_contract.targets import TargetsMessage
from hapticd_contract.web import Follow

from ...io.clients.inbox import BURST, RATE_HZ
from ..web.sockets import Outbox, Pace, read, until_one_ends
from . import messages
from .messages import RefusedMessage
from .shared_daemon import STATES, SharedDaemon

MAX_REQUESTS: Final = 8  # that wait, as at the daemon
ANSWER_S: Final = 2.0  # within which a daemon takes a request


class Peer:
    """Relays between one WebSocket and the daemon until either side of the WebSocket closes it."""

    def __init__(self, daemon: SharedDaemon) -> None:
        self._daemon = daemon
        self._name: str | None = None
        self._pace = Pace(RATE_HZ, BURST)
        self._outbox = Outbox(STATES)
        self._targets_socket = daemon.connected(zmq.PUSH, "targets")
        self._control_socket = daemon.connected(zmq.DEALER, "control")
        self._targets = b"", 0.0  # the newest, and until when they hold
        self._has_targets = asyncio.Event()
        self._requests: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue(MAX_REQUESTS)

    async def relay(self, socket: web.WebSocketResponse) -> None:
        """Return when the WebSocket is closed."""
        try:
            await until_one_ends(
                read(socket, self._pace, self._receive),
                self._outbox.write(socket),
                self._send_targets(),
                self._send_requests(),
                self._receive_replies(),
            )
        finally:
            self._daemon.leave(self)
            self._daemon.names.discard(self._name or "")
            self._targets_socket.close()
            self._control_socket.close()

    # --- from the WebSocket ---

    def _receive(self, message: WSMessage) -> None:
        try:
            if message.type is not WSMsgType.TEXT:
                raise RefusedMessage("A message is a JSON text, this one is binary.")
            self._take(messages.decode(message.data))
        except RefusedMessage as error:
            self._outbox.add(messages.refusal(str(error), error.request_id))

    def _take(self, message: messages.Received) -> None:
        if isinstance(message, Follow):
            self._follow(message.states)
            return
        payload = messages.encode(message)
        self._claim(message)
        if isinstance(message, TargetsMessage):
            self._targets = payload, _now_s() + message.ttl_s
            self._has_targets.set()
        elif self._requests.full():
            why = f"{MAX_REQUESTS} requests of this connection wait already: await replies first."
            raise RefusedMessage(why, message.id)
        else:
            self._requests.put_nowait((message.id, payload))

    def _claim(self, message: TargetsMessage | Request) -> None:
        """Take the message's name, if it has one, for this peer. Raises RefusedMessage."""
        name = messages.client_of(message)
        if name is None or name == self._name:
            return
        if self._name is not None:
            why = f"client: this connection is {self._name!r}: open another one for a second client."
        elif name in self._daemon.names:
            why = f"client: {name!r} is the name of another connection: choose another."
        else:
            self._name = name
            self._daemon.names.add(name)
            return
        raise RefusedMessage(why, messages.id_of(message))

    def _follow(self, states: str) -> None:
        self._daemon.leave(self)
        if states != "none":
            numbers = itertools.count() if states == "every" else itertools.repeat(0)
            self._daemon.follow(self, lambda text: self._outbox.newest(next(numbers), text))

    # --- to the daemon ---

    async def _send_targets(self) -> None:
        """Send the newest targets as soon as there is a daemon, if they still hold."""
        while True:
            await self._has_targets.wait()
            await _is_writable(self._targets_socket)
            self._has_targets.clear()
            payload, t_end_s = self._targets
            if _now_s() < t_end_s:
                await self._targets_socket.send(payload)

    async def _send_requests(self) -> None:
        while True:
            request_id, payload = await self._requests.get()
            if await _is_writable(self._control_socket, int(ANSWER_S * 1000)):
                await self._control_socket.send(payload)
            else:
                sentence = f"No hapticd answers at {self._daemon.find()}: start one, then try again."
                self._outbox.add(messages.refusal(sentence, request_id))

    async def _receive_replies(self) -> None:
        while True:
            payload = await self._control_socket.recv()
            with self._pace:  # the plate's has 400 kB
                self._outbox.add(messages.text_of(payload))


async def _is_writable(socket: zmq.asyncio.Socket, timeout_ms: int | None = None) -> bool:
    """Wait for a daemon; return whether there is one."""
    poll: Any = socket.poll  # pyzmq's types leave out the second argument
    return bool(await poll(timeout_ms, zmq.POLLOUT))


def _now_s() -> float:
    return asyncio.get_running_loop().time()
