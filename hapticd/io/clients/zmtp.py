"""Inbound bytes of a subscriber, checked before ZeroMQ gets them (ZMTP 3, https://rfc.zeromq.org/spec/23).

libzmq stores every distinct subscription of a peer without a bound, and the daemon's thread pays for each. So a
subscriber's bytes are bounded, and where they are not encrypted only the daemon's own topics pass.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator

GREETING_BYTES = 64
MAX_FRAME_BYTES = 512  # of a handshake with the longest identity, or of a heartbeat
MAX_CHANGES = 16  # of one connection's subscriptions; a client subscribes once
MAX_SUBSCRIBER_BYTES = 1024  # a handshake of up to 900 bytes, its subscription, a few heartbeats
HEARTBEAT_BYTES_HZ = 64.0  # of a local subscriber, on top: seven heartbeats a second

_LONG, _COMMAND = 0x02, 0x04

Inbound = Callable[[bytes], bytes]  # takes what arrived, returns what to pass on; raises ProtocolError


class ProtocolError(Exception):
    """The connection must be closed."""


class LocalInbound:
    """Inbound bytes of a local subscriber: its handshake, heartbeats, and subscriptions to `topics`."""

    def __init__(self, topics: frozenset[bytes], *, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._topics = topics
        self._bounded = SubscriberInbound(HEARTBEAT_BYTES_HZ, clock_s).feed
        self._waiting = b""
        self._greeting_left = GREETING_BYTES
        self._is_ready = False
        self._changes_left = MAX_CHANGES
        self._subscribed: set[bytes] = set()

    def feed(self, data: bytes) -> bytes:
        """Return the bytes to pass on. Raises ProtocolError."""
        self._waiting += self._bounded(data)
        passed = self._greeting()
        if self._greeting_left > 0:
            return passed
        for header, body in self._frames():
            if not self._is_ready and not (header[0] & _COMMAND and body.startswith(b"\x05READY")):
                raise ProtocolError("no READY")
            if not self._is_ready or self._is_passed(header, body):
                passed += header + body
            self._is_ready = True
        return passed

    def _greeting(self) -> bytes:
        """Return the part of the greeting that arrived: signature, version 3 or later, mechanism."""
        begin = GREETING_BYTES - self._greeting_left
        part, self._waiting = self._waiting[: self._greeting_left], self._waiting[self._greeting_left :]
        self._greeting_left -= len(part)
        if begin == 0 and part[:1] not in (b"", b"\xff"):
            raise ProtocolError("no ZMTP")
        if begin <= 10 < begin + len(part) and part[10 - begin] < 3:
            raise ProtocolError("a version of ZMTP before 3")
        return part

    def _frames(self) -> Iterator[tuple[bytes, bytes]]:
        """Take whole frames from the waiting bytes, as header and body."""
        while len(self._waiting) >= 2:
            header_bytes = 9 if self._waiting[0] & _LONG else 2
            if len(self._waiting) < header_bytes:
                return
            header = self._waiting[:header_bytes]
            size = struct.unpack(">Q", header[1:])[0] if header_bytes == 9 else header[1]
            if size > MAX_FRAME_BYTES:
                raise ProtocolError("too long a frame")
            if len(self._waiting) < header_bytes + size:
                return
            body = self._waiting[header_bytes : header_bytes + size]
            self._waiting = self._waiting[header_bytes + size :]
            yield header, body

    def _is_passed(self, header: bytes, body: bytes) -> bool:
        """Return whether a subscriber's frame concerns the daemon: a change of a known topic, or a heartbeat."""
        if header[0] & _COMMAND:
            length = body[0] if body else 0
            name, topic = body[1 : 1 + length], body[1 + length :]
            if name in (b"PING", b"PONG"):
                return True
            begins, ends = name == b"SUBSCRIBE", name == b"CANCEL"
        else:
            topic, begins, ends = body[1:], body[:1] == b"\x01", body[:1] == b"\x00"
        if topic not in self._topics or not (begins or ends) or begins == (topic in self._subscribed):
            return False
        self._subscribed ^= {topic}
        self._changes_left -= 1
        if self._changes_left < 0:
            raise ProtocolError("too many changes of its subscriptions")
        return True


class SubscriberInbound:
    """Inbound bytes of a subscriber: at most MAX_SUBSCRIBER_BYTES, which bounds its subscriptions and their parsing.

    One whose subscriptions are checked as well may send `more_bytes_hz` for ever.
    """

    def __init__(self, more_bytes_hz: float = 0.0, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._left: float = MAX_SUBSCRIBER_BYTES
        self._more_bytes_hz = more_bytes_hz
        self._clock_s = clock_s
        self._t_s = clock_s()

    def feed(self, data: bytes) -> bytes:
        """Return the bytes to pass on. Raises ProtocolError."""
        before_s, self._t_s = self._t_s, self._clock_s()
        self._left = min(self._left + (self._t_s - before_s) * self._more_bytes_hz, MAX_SUBSCRIBER_BYTES) - len(data)
        if self._left < 0.0:
            raise ProtocolError("more than a subscriber has to send")
        return data
