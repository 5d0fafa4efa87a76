"""A client that offers the service messages as fast as it can: `python -m hapticd.bench.soak_flood ENDPOINT NAME`.

The messages are valid and without targets, so that the service parses all of each. Messages that the client's full
socket refuses are dropped. When standard input ends, it prints the number of messages offered and sent.
"""

from __future__ import annotations

import select
import sys
import time

import msgpack
import zmq

POLL_EVERY = 1000  # messages between two polls of standard input


def main(endpoint: str, name: str) -> None:
    """Offer until standard input ends."""
    offered = sent = 0
    with zmq.Context() as context, context.socket(zmq.PUSH) as socket:
        socket.linger = 0
        socket.connect(endpoint)
        print("ready", flush=True)
        while offered % POLL_EVERY != 0 or not select.select([sys.stdin], [], [], 0.0)[0]:
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
