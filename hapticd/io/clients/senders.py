"""Sender identity of client messages, and the rate limit per sender.

The identity comes from the kernel (ipc) or from the authenticated key (TCP), never from the message.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import zmq

RATE_HZ = 500.0  # messages of one sender on one socket; the plate is updated 90 times a second
BURST = 100  # messages at once after a pause
MAX_SENDERS = 64  # tracked; the one idle longest is dropped first


@dataclass(frozen=True, slots=True)
class Sender:
    """`user` owns the targets of the message; messages of one `source` share one rate limit."""

    user: str
    source: str


UNKNOWN = Sender("an unknown user", "an unknown user")


def local_sender(pid: int, uid: int) -> Sender:
    """Return the sender of a connection whose process the kernel reports."""
    return Sender(f"uid {uid}", f"process {pid} of uid {uid}")


def remote_sender(frame: zmq.Frame, key_names: Mapping[str, str]) -> Sender:
    """Return the sender of a frame received over TCP; `key_names` maps the allowed public keys (Z85) to names.

    libzmq keeps the User-Id that the authenticator assigned, whatever the client claims.
    """
    try:
        name = key_names.get(str(frame.get("User-Id")))
    except zmq.ZMQError:  # it has none
        name = None
    return UNKNOWN if name is None else Sender(f"key {name}", f"key {name}")


@dataclass(slots=True)
class _Bucket:
    tokens: float
    t_s: float


class RateLimiter:
    """Token buckets: admits `rate_hz` uses of each source, `burst` at once."""

    def __init__(self, rate_hz: float = RATE_HZ, burst: int = BURST) -> None:
        self._rate_hz = rate_hz
        self._burst = float(burst)
        self._buckets: dict[str, _Bucket] = {}

    def admit(self, source: str, t_s: float) -> bool:
        """Return whether the source has a token, and take it."""
        bucket = self._buckets.pop(source, None)  # re-inserted at the end: the first is the one idle longest
        if bucket is None:
            bucket = _Bucket(self._burst, t_s)
            if len(self._buckets) >= MAX_SENDERS:
                del self._buckets[next(iter(self._buckets))]
        self._buckets[source] = bucket
        bucket.tokens = min(bucket.tokens + max(t_s - bucket.t_s, 0.0) * self._rate_hz, self._burst)
        bucket.t_s = t_s
        if bucket.tokens < 1.0:
            return False
        bucket.tokens -= 1.0
        return True
