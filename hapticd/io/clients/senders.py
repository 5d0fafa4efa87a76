"""Sender identity of client messages, and the rate limit per sender.

The identity comes from the kernel (ipc) or from the authenticated key (TCP), never from the message.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import zmq

from .zmtp import PEER_PROPERTY

RATE_HZ = 500.0  # messages of one sender on one socket; the plate is updated 90 times a second
BURST = 100  # messages at once after a pause
MAX_SENDERS = 64  # tracked; the one idle longest is dropped first

_LOCAL_PEER = re.compile(r"(\d+):(-?\d+):(\d+)")  # UID:PID:CONNECTION, which the gate adds
_UNKNOWN_USER = "an unknown user"

_Message = TypeVar("_Message")


@dataclass(frozen=True, slots=True)
class Sender:
    """`user` owns the targets of the message; messages of one `source` share one rate limit.

    `connection` is the gate's number of a local connection.
    """

    user: str
    source: str
    connection: int | None = None


def sender_of(frame: zmq.Frame, key_names: Mapping[str, str]) -> Sender:
    """Return the sender of a received frame; `key_names` maps the allowed public keys (Z85) to names.

    Over TCP libzmq keeps the User-Id that the authenticator assigned, so it takes precedence: such a client may claim a
    local identity. A local client cannot claim a User-Id, for the gate removes it.
    """
    key = _property(frame, "User-Id")
    name, local = key_names.get(key), _LOCAL_PEER.fullmatch(_property(frame, PEER_PROPERTY))
    if name is not None:
        return Sender(f"key {name}", f"key {name}")
    if key or local is None:
        return Sender(_UNKNOWN_USER, _UNKNOWN_USER)
    return Sender(f"uid {local[1]}", f"process {local[2]} of uid {local[1]}", int(local[3]))


def _property(frame: zmq.Frame, name: str) -> str:
    try:
        return str(frame.get(name))
    except zmq.ZMQError:  # it has none
        return ""


@dataclass(slots=True)
class _Bucket(Generic[_Message]):
    """Token bucket of one source, and its waiting messages."""

    tokens: float
    t_s: float
    waiting: deque[_Message]


class RateLimiter(Generic[_Message]):
    """Admit `rate_hz` messages of each source, `burst` at once. `lost` counts dropped messages.

    Messages beyond the rate wait in a queue of `queue_length`, which drops its oldest. With a length of 1 the newest
    message of a flood is always handled, with 0 none waits.
    """

    def __init__(self, queue_length: int, rate_hz: float = RATE_HZ, burst: int = BURST) -> None:
        self.lost = 0
        self._queue_length = queue_length
        self._rate_hz = rate_hz
        self._burst = burst
        self._buckets: dict[str, _Bucket[_Message]] = {}

    @property
    def is_waiting(self) -> bool:
        """Whether any message waits for a token."""
        return any(bucket.waiting for bucket in self._buckets.values())

    def admit(self, source: str, message: _Message, t_s: float) -> bool:
        """Return whether to handle this message now; if not, `due` yields it later unless newer ones replace it."""
        bucket = self._bucket_of(source, t_s)
        if not bucket.waiting and self._take_token(bucket, t_s):
            return True
        bucket.waiting.append(message)
        if len(bucket.waiting) > self._queue_length:
            bucket.waiting.popleft()
            self.lost += 1
        return False

    def due(self, t_s: float) -> Iterator[_Message]:
        """Yield the waiting messages whose source has a token."""
        for bucket in list(self._buckets.values()):
            while bucket.waiting and self._take_token(bucket, t_s):
                yield bucket.waiting.popleft()

    def _bucket_of(self, source: str, t_s: float) -> _Bucket[_Message]:
        bucket = self._buckets.pop(source, None)  # re-inserted at the end: the first is the one idle longest
        if bucket is None:
            bucket = _Bucket(float(self._burst), t_s, deque())
            if len(self._buckets) >= MAX_SENDERS:
                self.lost += len(self._buckets.pop(next(iter(self._buckets))).waiting)
        self._buckets[source] = bucket
        return bucket

    def _take_token(self, bucket: _Bucket[_Message], t_s: float) -> bool:
        bucket.tokens = min(bucket.tokens + max(t_s - bucket.t_s, 0.0) * self._rate_hz, float(self._burst))
        bucket.t_s = t_s
        if bucket.tokens < 1.0:
            return False
        bucket.tokens -= 1.0
        return True
