"""Requests to the daemon and their replies, one at a time; an id identifies late replies."""

from __future__ import annotations

import contextlib
import math
import time
from typing import Any

import zmq

from .endpoint import Endpoint
from .errors import DaemonGoneError
from .messages import encode_request, read_reply

MAX_REQUEST_ID = 2**32 - 1
_REMEDY = "start one (`hapticd run --sim` needs no hardware), or set HAPTICD_RUNTIME_DIR to its directory"
_REMEDY_FOR_KEYS = "check that it runs with client.tcp, that server_key is its key, and that it allows yours"


class Control:
    """The `control` socket of one client."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._request_id = 0
        self._socket = context.socket(zmq.DEALER)
        self._socket.linger = 0
        self._socket.immediate = True  # without a daemon a request times out here instead of being queued
        endpoint.connect(self._socket, "control")

    def request(self, op: str, body: object = None, *, timeout_s: float) -> dict[str, Any]:
        """Send a request and return its reply's body. Raises RefusedError, or DaemonGoneError after the timeout."""
        deadline_s = time.monotonic() + timeout_s
        self._request_id = self._request_id % MAX_REQUEST_ID + 1
        if self._ready(zmq.POLLOUT, deadline_s):
            with contextlib.suppress(zmq.Again):  # the daemon left since: no reply will come
                self._socket.send(encode_request(op, self._request_id, body), zmq.NOBLOCK)
        while self._ready(zmq.POLLIN, deadline_s):
            reply = read_reply(self._socket.recv(), self._request_id)
            if reply is not None:
                return reply
        raise DaemonGoneError(
            f"No hapticd answers at {self._endpoint}: {_REMEDY if self._endpoint.keys is None else _REMEDY_FOR_KEYS}."
        )

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _ready(self, event: int, deadline_s: float) -> bool:
        left_s = max(deadline_s - time.monotonic(), 0.0)
        return self._socket.poll(math.ceil(left_s * 1000), event) != 0
