"""Who sent a message, and how many messages of one sender are read.

The sender's name comes from the kernel (ipc) or from the key that it has proved to hold (TCP), never from what the
message says of itself.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import zmq

RATE_HZ = 500.0  # messages of one sender, on one socket; the plate itself is told 90 times a second
BURST = 100  # of these at once, after a pause
MAX_SENDERS = 64  # that are remembered; whoever was silent longest is forgotten first

_IPC_PEER = re.compile(r"[^:]*:(\d+):\d+:(-?\d+)")  # libzmq's "host:uid:gid:pid", from SO_PEERCRED
_UNKNOWN_USER = "an unknown user"

Message = TypeVar("Message")


@dataclass(frozen=True, slots=True)
class Sender:
    """`user` answers for the message and owns what it asks for; messages of one `source` share one rate."""

    user: str
    source: str


def sender_of(frame: zmq.Frame, key_names: Mapping[str, str]) -> Sender:
    """The sender of a received frame; `key_names` maps the allowed clients' public keys (Z85) to names.

    The kernel's word comes first: on ipc nobody is authenticated, and a client may put a User-Id of its own into the
    handshake. On TCP libzmq keeps the one that the authenticator gave.
    """
    address = _property(frame, "Peer-Address")
    local = _IPC_PEER.fullmatch(address)
    if local is not None:
        return Sender(f"uid {local[1]}", f"process {local[2]} of uid {local[1]}")
    name = key_names.get(_property(frame, "User-Id"))
    if name is None:
        return Sender(_UNKNOWN_USER, _UNKNOWN_USER)
    return Sender(f"key {name}", f"key {name}")


def _property(frame: zmq.Frame, name: str) -> str:
    try:
        return str(frame.get(name))
    except zmq.ZMQError:  # it has none
        return ""


@dataclass(slots=True)
class _Turn(Generic[Message]):
    """One source's account: what it may still have handled, and what waits until it may."""

    allowance: float
    t_s: float
    waiting: deque[Message]


class RateLimiter(Generic[Message]):
    """Lets RATE_HZ messages of each source through, BURST at once. `lost` counts those that never came through.

    What comes too fast waits, `patience` messages of it; of more, the oldest give way. With a patience of 1 the newest
    message of a flood is always the one that is handled in the end.
    """

    def __init__(self, patience: int) -> None:
        self.lost = 0
        self._patience = patience
        self._turns: dict[str, _Turn[Message]] = {}

    @property
    def is_waiting(self) -> bool:
        """Something waits for its turn."""
        return any(turn.waiting for turn in self._turns.values())

    def admit(self, source: str, message: Message, t_s: float) -> bool:
        """Whether this message may be handled now; if not, `due` brings it later, unless newer ones replace it."""
        turn = self._turn_of(source, t_s)
        if not turn.waiting and _has_earned_one(turn, t_s):
            return True
        if len(turn.waiting) == self._patience:
            turn.waiting.popleft()
            self.lost += 1
        turn.waiting.append(message)
        return False

    def due(self, t_s: float) -> Iterator[Message]:
        """Those whose turn has come, by and by."""
        for turn in list(self._turns.values()):
            while turn.waiting and _has_earned_one(turn, t_s):
                yield turn.waiting.popleft()

    def _turn_of(self, source: str, t_s: float) -> _Turn[Message]:
        turn = self._turns.pop(source, None)  # put back at the end: the first is the one silent longest
        if turn is None:
            turn = _Turn(float(BURST), t_s, deque())
            if len(self._turns) >= MAX_SENDERS:
                self.lost += len(self._turns.pop(next(iter(self._turns))).waiting)
        self._turns[source] = turn
        return turn


def _has_earned_one(turn: _Turn[Message], t_s: float) -> bool:
    turn.allowance = min(turn.allowance + max(t_s - turn.t_s, 0.0) * RATE_HZ, float(BURST))
    turn.t_s = t_s
    if turn.allowance < 1.0:
        return False
    turn.allowance -= 1.0
    return True
