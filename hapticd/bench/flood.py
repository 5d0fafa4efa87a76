"""A client that offers the service messages as fast as it can: `python -m hapticd.bench.flood ENDPOINT NAME`.

Each is whole and asks for nothing, so that the service reads it to its end. What the client's own socket does not take,
for its queue is full, is dropped, and the next is offered at once. It ends with its standard input, and then prints how
many it offered and how many its socket took.
"""

from __future__ import annotations

import select
import sys
import time

import msgpack
import zmq

LOOK_EVERY = 1000  # messages, between two looks at standard input


def main(endpoint: str, name: str) -> None:
    """Offer until standard input ends."""
    offered = sent = 0
    with zmq.Context() as context, context.socket(zmq.PUSH) as socket:
        socket.linger = 0
        socket.connect(endpoint)
        print("ready", flush=True)
        while offered % LOOK_EVERY != 0 or not select.select([sys.stdin], [], [], 0.0)[0]:
            message = {"v": 1, "client": name, "ttl_s": 0.5, "targets": [], "stamp": time.monotonic_ns()}
            offered += 1
            try:
                socket.send(msgpack.packb(message), zmq.NOBLOCK)
                sent += 1
            except zmq.Again:
                continue
    print(offered, sent, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
