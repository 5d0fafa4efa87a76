"""Receiver of every event of the plate, in order: no state is skipped."""

from __future__ import annotations

import math

import zmq

from hapticd_contract.states import PlateEvent

from .endpoint import Endpoint
from .errors import DaemonGoneError
from .messages import decode_state

BACKLOG = 4096  # states that wait for a reader: some 40 s


class EventReader:
    """A `telemetry` socket of its own, connected on first use. A reader that is away for longer than the backlog loses
    events, which their numbers show."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._socket = context.socket(zmq.SUB)
        self._socket.linger = 0
        self._socket.rcvhwm = BACKLOG
        self._is_connected = False

    def connect(self) -> None:
        """Subscribe; drop what was queued, events from now on are kept for `next`."""
        if not self._is_connected:
            self._socket.subscribe(b"")
            self._endpoint.connect(self._socket, "telemetry")
            self._is_connected = True
        while self._socket.poll(0) != 0:
            self._socket.recv()

    def next(self, timeout_s: float) -> tuple[PlateEvent, ...]:
        """Return the events of the next state, often none. Raises DaemonGoneError after the timeout."""
        if self._socket.poll(math.ceil(timeout_s * 1000)) == 0:
            raise DaemonGoneError(f"No state from {self._endpoint} for {timeout_s:g} s: check that hapticd is running.")
        return decode_state(self._socket.recv()).events

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
