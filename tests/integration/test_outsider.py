"""A client written from clients/PROTOCOL.md alone, without code of the project, against the running service."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq
from service import drive, opened

ANSWER_MS = 10_000
MOVING = {"name": "walker", "path_mm": [[-40, 20], [40, 20]], "speed_mm_s": 80.0, "loop": True}
Fields = dict[str, Any]


class Outsider:
    """One program's PUSH, DEALER and SUB."""

    def __init__(self, directory: Path, name: str) -> None:
        self.name = name
        self._context = zmq.Context()
        self._ids = itertools.count(1)
        self.targets = self._connected(zmq.PUSH, directory / "targets")
        self.control = self._connected(zmq.DEALER, directory / "control")
        self.telemetry = self._connected(zmq.SUB, directory / "telemetry")

    def _connected(self, kind: int, path: Path) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.rcvtimeo = ANSWER_MS
        if kind == zmq.SUB:
            socket.subscribe(b"")
        else:
            socket.immediate = True
        socket.connect(f"ipc://{path}")
        return socket

    def close(self) -> None:
        self._context.destroy(linger=0)

    def reply(self, *parts: bytes) -> Fields:
        """Send a request of these parts, and return its reply."""
        self.control.send_multipart(parts)
        reply: Fields = msgpack.unpackb(self.control.recv())
        assert reply["v"] == 1
        assert isinstance(reply.get("body"), dict) if reply["ok"] else isinstance(reply["error"], str)
        return reply

    def request(self, op: str, **body: Any) -> Fields:
        request_id = next(self._ids)
        reply = self.reply(msgpack.packb({"v": 1, "id": request_id, "op": op} | ({"body": body} if body else {})))
        assert reply["id"] == request_id
        return reply

    def set(self, *targets: Fields, **more: Any) -> Fields:
        return self.request("set", client=self.name, targets=list(targets), **more)

    def push(self, *targets: Fields, **more: Any) -> None:
        assert self.targets.poll(ANSWER_MS, zmq.POLLOUT)
        self.targets.send(msgpack.packb({"v": 1, "client": self.name, "targets": list(targets), **more}), zmq.NOBLOCK)

    def state(self, is_awaited: Callable[[Fields], bool] = lambda _: True) -> Fields:
        """The first state from now on that is awaited."""
        t_end_s = time.monotonic() + ANSWER_MS / 1000
        while True:
            state: Fields = msgpack.unpackb(self.telemetry.recv())
            if is_awaited(state):
                return state
            assert time.monotonic() < t_end_s, state


def finger(state: Fields, finger_id: int | str) -> Fields:
    """The finger of a state; empty if it is not there."""
    return next((one for one in state["fingers"] if one["id"] == finger_id), {})


@pytest.fixture(scope="module")
def clients() -> Iterator[tuple[Outsider, Outsider]]:
    """Two clients of a service whose two fingers are down."""
    with opened() as bench:
        bench.rig("rest")
        bench.service()
        drive(bench.client())  # it is driven once
        bench.close_clients()
        made = Outsider(bench.runtime_dir, "outsider"), Outsider(bench.runtime_dir, "another")
        yield made
        for one in made:
            one.close()


def test_requests_targets_and_states_are_those_of_the_protocol(clients: tuple[Outsider, Outsider]) -> None:
    client, other = clients
    hello = client.request("hello")["body"]
    assert (hello["protocol"], "stamp" in hello["optional"], type(hello["instance"])) == (1, True, int)
    bounds = client.request("capabilities")["body"]
    assert (bounds["max_targets"], bounds["max_virtuals"], bounds["max_message_bytes"]) == (16, 16, 65536)
    plate = client.request("plate")["body"]
    assert len(plate["shapes"]) == 4 * plate["modes"] * len(plate["y_mm"]) * len(plate["x_mm"])
    before, state = client.state(lambda state: len(state["fingers"]) == 2), client.state()
    assert (state["instance"], state["seq"], state["t_ns"] > before["t_ns"]) == (
        hello["instance"],
        before["seq"] + 1,
        True,
    )
    left, right = (one["id"] for one in state["fingers"])

    client.push({"finger": left, "amplitude_um": 1.0}, {"finger": right, "friction": 1.0}, ttl_s=0.2)
    state = client.state(lambda state: finger(state, left)["target_um"] == 1.0)
    assert [(one["target_um"], one["owner"]) for one in state["fingers"]] == [(1.0, "outsider"), (0.0, "outsider")]
    client.state(lambda state: finger(state, left)["owner"] is None and finger(state, left)["target_um"] == 0.0)

    target = {"finger": left, "amplitude_um": 1.0}
    assert client.set(target, stamp=100, ttl_s=5.0)["ok"]
    assert "newer message" in client.set(target, stamp=99)["error"]
    assert f"finger {left} is held by 'outsider'" in other.set(target)["error"]
    assert other.request("release", client="another", finger=left)["body"] == {"released": False}

    assert client.set({"finger": "walker", "amplitude_um": 0.0}, virtuals=[MOVING], ttl_s=5.0)["ok"]
    x_mm = finger(client.state(lambda state: finger(state, "walker") != {}), "walker")["x_mm"]
    client.state(lambda state: finger(state, "walker")["x_mm"] != x_mm)
    outside = MOVING | {"path_mm": [[500, 0]]}
    assert "leaves the plate" in client.set({"finger": "walker", "amplitude_um": 1.0}, virtuals=[outside])["error"]
    t_ns = client.request("marker", client="outsider", text="trial 12 begins")["body"]["t_ns"]
    marked = client.state(lambda state: "markers" in state)
    assert marked["markers"] == [{"t_ns": t_ns, "client": "outsider", "text": "trial 12 begins"}]
    assert client.request("release", client="outsider")["ok"]
