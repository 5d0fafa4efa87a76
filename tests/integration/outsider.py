"""A client written from clients/PROTOCOL.md alone: it shares no code with the daemon or with hapticd-client."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import zmq

ANSWER_MS = 10_000
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
        socket.linger = 0
        socket.rcvtimeo = ANSWER_MS
        if kind == zmq.SUB:
            socket.subscribe(b"")
        else:
            socket.immediate = True
        socket.connect(f"ipc://{path}")
        return socket

    def close(self) -> None:
        self._context.destroy()

    def reply(self, *parts: bytes) -> Fields:
        """Send a request of these parts, and return its reply."""
        self.control.send_multipart(parts)
        reply = msgpack.unpackb(self.control.recv())
        assert isinstance(reply, dict)
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

    def release(self) -> None:
        assert self.request("release", client=self.name)["ok"]

    def state(self, is_wanted: Callable[[Fields], bool] = lambda _: True) -> Fields:
        """The first state from now on that is wanted."""
        t_end_s = time.monotonic() + ANSWER_MS / 1000
        while True:
            state = msgpack.unpackb(self.telemetry.recv())
            assert isinstance(state, dict)
            if is_wanted(state):
                return state
            assert time.monotonic() < t_end_s, state


def finger(state: Fields, finger_id: int | str) -> Fields:
    """The finger of a state; empty if it is not there."""
    return next((one for one in state["fingers"] if one["id"] == finger_id), {})
