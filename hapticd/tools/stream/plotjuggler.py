"""`hapticd stream plotjuggler`: each state as one flat MessagePack map, published over ZeroMQ.

This folder's README describes what PlotJuggler's "ZMQ Subscriber" and its MessagePack parser expect.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import msgpack
import zmq

from ...errors import UsageError
from .samples import Sampler, Value
from .states import serve

BACKLOG = 1000  # messages queued for a slow subscriber, which then misses some


def encode(row: Mapping[str, Value]) -> bytes:
    """Encode one message: one part, one map, keys in the row's order, floats of 64 bits."""
    return bytes(msgpack.packb(row))


def run(endpoint: str | None, address: str, fingers: int, ended: Callable[[], bool] = lambda: False) -> None:
    """Publish at `address` until `ended` or Ctrl-C, without waiting for subscribers. Raises HapticdError."""
    unix_offset_ns = time.time_ns() - time.monotonic_ns()  # constant, so that setting the clock moves no curve back
    sampler = Sampler(fingers)
    with zmq.Context() as context, context.socket(zmq.PUB) as socket:
        socket.linger = 0
        socket.sndhwm = BACKLOG
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            raise UsageError(
                f"--bind {address}: cannot be bound ({error.strerror}): give an address such as tcp://127.0.0.1:9873."
            ) from None
        print(f"states as MessagePack at {socket.get_string(zmq.LAST_ENDPOINT)}\n(Ctrl-C ends)", flush=True)
        serve(lambda state: socket.send(encode(sampler.row(state, unix_offset_ns)), zmq.NOBLOCK), endpoint, ended)
