"""A client with legal messages that take long: `legal_client.py NUMBER SOCKET SECONDS DIRECTORY`, or with
`tcp://HOST:PORT SERVER_KEY OWN_KEY` in place of the directory.

20 scenes a second that hold for up to 2 s: fingers that it takes and leaves, surfaces and effects. They are messages of
`targets`, or requests `set` whose replies it does not await. It disconnects after so many seconds; with 0 it goes on
until it is killed.
"""

from __future__ import annotations

import itertools
import random
import sys
import time
from typing import Any

RATE_HZ = 20.0
TTLS_S = (0.2, 1.0, 2.0)
FINGERS = (1, 2)
SIDE, MAPS = 48, 16
EFFECTS, POINTS = 16, 64


def scene(rng: random.Random, client: str) -> dict[str, Any]:
    fingers = rng.sample(FINGERS, rng.randint(1, len(FINGERS)))
    maps = [{"width": SIDE, "height": SIDE, "levels": rng.randbytes(SIDE**2), "friction": [rng.random(), 1.0]}] * MAPS
    points = [[0.01 * n, 0.5 * rng.random()] for n in range(POINTS)]
    return {
        "client": client,
        "ttl_s": rng.choice(TTLS_S),
        "targets": [{"finger": one, "amplitude_um": rng.uniform(0.2, 1.0)} for one in fingers],
        "surfaces": [{"name": f"s{n}", "map": one, "z": rng.randrange(9)} for n, one in enumerate(maps)],
        "effects": [{"name": f"e{n}", "envelope": {"points": points}, "loops": True} for n in range(EFFECTS)],
    }


if __name__ == "__main__":
    import msgpack
    import zmq

    from hapticd_client.endpoint import find

    number, name, seconds, endpoint, *keys = sys.argv[1:]
    rng = random.Random(int(number))
    context = zmq.Context()
    client = context.socket(zmq.PUSH if name == "targets" else zmq.DEALER)
    client.linger = 0
    find(endpoint, {}, *keys).connect(client, name)
    t_end_s = time.monotonic() + float(seconds) if float(seconds) > 0.0 else float("inf")
    print("ready", flush=True)
    for sent in itertools.count(1):
        if time.monotonic() >= t_end_s:
            break
        body = scene(rng, f"legal-{number}")
        message = {"v": 1, **body} if name == "targets" else {"v": 1, "id": sent, "op": "set", "body": body}
        if client.poll(0, zmq.POLLOUT):
            client.send(msgpack.packb(message), zmq.NOBLOCK)
        time.sleep(1.0 / RATE_HZ)
    context.destroy(linger=0)
