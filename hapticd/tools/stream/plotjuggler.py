"""`hapticd stream plotjuggler`: each state as one flat MessagePack map, published over ZeroMQ.

This folder's README describes what PlotJuggler's "ZMQ Subscriber" and its MessagePack parser expect.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import msgpack
import zmq

from ...errors import UsageError
from .samples import Sampler, Value
from .states import serve

BACKLOG = 1000  # messages queued for a slow subscriber, which then misses some


def encode(row: Mapping[str, Value]) -> bytes:
    """Encode one message: one part, one map, keys in the row's order, floats of 64 bits."""
    return bytes(msgpack.packb(dict(row)))


class Publisher:
    """A PUB socket at `address`, such as tcp://127.0.0.1:9872. Raises UsageError if it cannot be bound."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], address: str) -> None:
        self._socket = context.socket(zmq.PUB)
        self._socket.linger = 0
        self._socket.sndhwm = BACKLOG
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self._socket.close()
            raise UsageError(
                f"--bind {address}: cannot be bound ({error.strerror}): give an address such as tcp://127.0.0.1:9873."
            ) from None
        self.address = self._socket.get_string(zmq.LAST_ENDPOINT)

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def publish(self, payload: bytes) -> None:
        """Send to all subscribers, without blocking."""
        self._socket.send(payload, zmq.NOBLOCK)


def run(endpoint: str | None, address: str, fingers: int, ended: Callable[[], bool] = lambda: False) -> None:
    """Publish until `ended` or Ctrl-C. Raises HapticdError."""
    unix_offset_ns = time.time_ns() - time.monotonic_ns()  # constant, so that setting the clock moves no curve back
    sampler = Sampler(fingers)
    context: Any = zmq.Context()
    try:
        with Publisher(context, address) as publisher:
            print(f"states as MessagePack at {publisher.address}\n(Ctrl-C ends)", flush=True)
            serve(lambda state: publisher.publish(encode(sampler.row(state, unix_offset_ns))), endpoint, ended)
    finally:
        context.term()
