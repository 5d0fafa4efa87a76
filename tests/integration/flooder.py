"""A hostile client: `flooder.py KIND DIRECTORY`, or `flooder.py KIND tcp://HOST:PORT SERVER_KEY OWN_KEY`."""

from __future__ import annotations

import itertools
import os
import random
import socket
import sys
import time
from pathlib import Path

import msgpack
import zmq
import zmq.auth

NAMES = {"targets": zmq.PUSH, "control": zmq.DEALER, "telemetry": zmq.SUB}
SOCKETS = 500
REQUESTERS = 140
NOBODY = 65534
OTHER_ADDRESS = "127.0.0.2"
is_program = __name__ == "__main__"  # the test imports KINDS alone
if is_program:
    context = zmq.Context()
    context.set(zmq.MAX_SOCKETS, 2 * SOCKETS)
endpoint = sys.argv[2] if is_program else ""
is_remote = endpoint.startswith("tcp://")


def address(name: str) -> tuple[str, int]:
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    return host, int(port) + list(NAMES).index(name)


def connected(name: str) -> zmq.Socket[bytes]:
    client = context.socket(NAMES[name])
    client.linger = 0
    if is_remote:
        client.curve_serverkey = zmq.auth.load_certificate(sys.argv[3])[0]
        client.curve_publickey, client.curve_secretkey = zmq.auth.load_certificate(sys.argv[4])
        client.connect("tcp://{}:{}".format(*address(name)))
    else:
        client.connect(f"ipc://{endpoint}/{name}")
    return client


def subscriptions() -> None:
    """Thousands of distinct subscriptions of a kilobyte."""
    client = connected("telemetry")
    for n in itertools.count():
        client.subscribe(b"%08d" % n + os.urandom(992))
        time.sleep(0.0001 if n < 26_000 else 1.0)


def unread() -> None:
    """Requests for the longest reply, none of which is read."""
    clients = [connected("control") for _ in range(REQUESTERS)]
    for n in itertools.count(1):
        for client in clients:
            if client.poll(0, zmq.POLLOUT):
                client.send(msgpack.packb({"v": 1, "id": n, "op": "plate"}), zmq.NOBLOCK)
        time.sleep(0.02)


def churn() -> None:
    """500 sockets that connect, and close again."""
    for _ in itertools.count():
        clients = [connected(name) for _, name in zip(range(SOCKETS), itertools.cycle(NAMES), strict=False)]
        for client in clients:
            if client.type == zmq.SUB:
                client.subscribe(b"")
        time.sleep(0.1)
        for client in clients:
            client.close()


def closing() -> None:
    """Connections of another user (over TCP: from another address) that are closed at once, one after the other."""
    if os.geteuid() == 0:
        os.setuid(NOBODY)  # the group that may open the sockets stays
    for name in itertools.cycle(NAMES):
        with socket.socket(socket.AF_INET if is_remote else socket.AF_UNIX) as client:
            if is_remote:
                client.bind((OTHER_ADDRESS, 0))
            client.connect(address(name) if is_remote else f"{endpoint}/{name}")


def expensive() -> None:
    """Another user's scenes that cost as much as any may, another one every 20 ms."""
    sys.path.append(str(Path(__file__).parents[1]))
    from expensive_scenes import scene

    if os.geteuid() == 0 and not is_remote:
        os.setuid(NOBODY)
    rng = random.Random(1)
    scenes = [[msgpack.packb(message) for message in scene(rng)] for _ in range(50)]
    clients = [connected("targets") for _ in scenes[0]]
    for messages in itertools.cycle(scenes):
        for client, message in zip(clients, messages, strict=True):
            if client.poll(0, zmq.POLLOUT):
                client.send(message, zmq.NOBLOCK)
        time.sleep(0.02)


KINDS = {one.__name__: one for one in (subscriptions, unread, churn, closing, expensive)}

if __name__ == "__main__":
    print("ready", flush=True)
    KINDS[sys.argv[1]]()
