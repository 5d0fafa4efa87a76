"""Messages of one connection to `targets`, `control` or `record`, with a ZeroMQ socket of its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import zmq

from .relay import Relay
from .sockets import MAX_MESSAGE_BYTES, RECEIVE_HIGH_WATER, Socket

MAX_READS = RECEIVE_HIGH_WATER  # at once: all that ZeroMQ holds, which of `targets` is a flood
MAX_PARTS = 3  # of a request: identity, an empty delimiter from REQ clients, payload
MAX_WAITING_BYTES = RECEIVE_HIGH_WATER * MAX_MESSAGE_BYTES  # of requests; of `targets` only the newest message matters
RATE_HZ = 500.0  # messages of one connection; the plate is updated 90 times a second
BURST = 100  # messages at once after a pause
UNKNOWN = "an unknown user"


class ClientMessage(NamedTuple):
    """A message in its parts, and the latest instant at which it can have arrived."""

    frames: Sequence[zmq.Frame]
    t_arrived_s: float


class Inbox:
    """Messages of one client that the daemon has not handled. It ends with the connection, and nothing outlives it."""

    def __init__(
        self,
        socket: Socket,
        user: str | None,
        lost: dict[str, int],
        now_s: Callable[[], float],
        on_close: Callable[[Inbox], None],
    ) -> None:
        """`user` is None over TCP, where each frame has a key. `lost` counts messages by why they are dropped."""
        self.socket = socket
        self.fd = socket.FD
        self.relay: Relay | None = None  # of its connection, once that is admitted
        self.is_control = socket.type == zmq.ROUTER
        self._waiting: deque[ClientMessage] = deque()
        self._waiting_bytes = 0
        self._user, self._lost = user, lost
        self._now_s, self._on_close = now_s, on_close
        self._t_arrived_s = self._t_admitted_s = now_s()
        self._tokens = float(BURST)

    @property
    def is_behind(self) -> bool:
        """Whether the client leaves replies unread: then its requests wait."""
        return self.relay is not None and self.relay.is_behind

    @property
    def has_more(self) -> bool:
        """Whether messages may be left; consumes the edge of the socket's descriptor."""
        return bool(self._waiting) or bool(int(self.socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN)

    def note_arrival(self, _bytes: int) -> bool:
        """Keep the instant at which bytes have arrived; the connection goes on."""
        self._t_arrived_s = self._now_s()
        return True

    def admit(self, t_s: float) -> bool:
        """Return whether the rate limit, RATE_HZ and BURST at once, lets a message pass now."""
        self._tokens = min(self._tokens + max(t_s - self._t_admitted_s, 0.0) * RATE_HZ, BURST)
        self._t_admitted_s = t_s
        is_admitted = self._tokens >= 1.0
        self._tokens -= is_admitted
        return is_admitted

    def read(self, refusal_of_parts: bytes) -> bool:
        """Read what waits in the socket; return whether there is a message to handle."""
        for _ in range(MAX_READS):
            frames = received(self.socket)
            if frames is None:
                return bool(self._waiting)
            if self._has_shape(frames):
                self._keep(ClientMessage(frames, self._t_arrived_s))
                continue
            self._lost["misshapen"] += 1
            if self.is_control:
                self.reply(frames[: 2 if len(frames[1]) == 0 else 1], refusal_of_parts)
        if not self.is_control:
            self._lost["too_fast"] += MAX_READS - 1
        return bool(self._waiting)

    def user_by(self, key_names: Mapping[str, str]) -> str:
        """Return the sender, over TCP by the key of the message that waits, which is that of the connection: libzmq
        keeps the User-Id that the authenticator assigned. `key_names` maps public keys (Z85) to names."""
        if self._user is None:
            name = key_names.get(str(self._waiting[0].frames[-1].get("User-Id")))
            self._user = UNKNOWN if name is None else f"key {name}"
        return self._user

    def pop(self) -> ClientMessage:
        """Take the oldest message that waits."""
        message = self._waiting.popleft()
        self._waiting_bytes -= len(message.frames[-1])
        return message

    def reply(self, envelope: Sequence[zmq.Frame], payload: bytes) -> None:
        """Answer a request; dropped for a client that does not read."""
        self.socket.send_multipart([*(frame.bytes for frame in envelope), payload], zmq.NOBLOCK)

    def close(self) -> None:
        """End, with all that is not handled."""
        self._on_close(self)
        self._waiting.clear()
        self.socket.close()

    def _keep(self, message: ClientMessage) -> None:
        """Queue a request; of `targets` the newest message replaces the one that waits."""
        self._waiting.append(message)
        self._waiting_bytes += len(message.frames[-1])
        while len(self._waiting) > 1 and (not self.is_control or self._waiting_bytes > MAX_WAITING_BYTES):
            self.pop()
            self._lost["too_fast"] += self.is_control

    def _has_shape(self, frames: Sequence[zmq.Frame]) -> bool:
        """Return whether the number of parts is right; of three the second is a REQ client's delimiter."""
        if not self.is_control:
            return len(frames) == 1
        return len(frames) == 2 or (len(frames) == 3 and len(frames[1]) == 0)


def received(socket: Socket) -> Sequence[zmq.Frame] | None:
    """Receive the parts of the next message without blocking; parts beyond MAX_PARTS are discarded."""
    if not int(socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:  # the usual case: a quarter of the cost of `zmq.Again`
        return None
    try:
        frames = [socket.recv(zmq.NOBLOCK, copy=False)]
    except zmq.Again:
        return None
    while socket.rcvmore:
        frame = socket.recv(copy=False)
        if len(frames) > MAX_PARTS:
            frames.pop()
        frames.append(frame)
    return frames
