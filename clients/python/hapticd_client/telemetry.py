"""Receiver of the newest plate state; older ones are dropped, so that a slow reader never lags."""

from __future__ import annotations

import math
import time

import zmq

from hapticd_contract.states import PlateState

from .endpoint import Endpoint
from .errors import DaemonGoneError
from .messages import decode_state

FRESH_S = 0.25  # the daemon sends a state at least ten times a second


class Telemetry:
    """The `telemetry` socket of one client, connected on first use: the daemon builds states only for subscribers."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._socket = context.socket(zmq.SUB)
        self._socket.linger = 0
        self._socket.conflate = True
        self._is_connected = False
        self._t_last_s = -math.inf
        self._last: PlateState | None = None

    def next(self, timeout_s: float) -> PlateState:
        """Return the newest unread state. Raises DaemonGoneError after the timeout."""
        if not self._is_connected:
            self._socket.subscribe(b"")
            self._endpoint.connect(self._socket, "telemetry")
            self._is_connected = True
        if self._socket.poll(math.ceil(timeout_s * 1000)) == 0:
            raise DaemonGoneError(f"No state from {self._endpoint} for {timeout_s:g} s: check that hapticd is running.")
        self._last = decode_state(self._socket.recv())
        self._t_last_s = time.monotonic()
        return self._last

    def current(self, timeout_s: float) -> PlateState:
        """Return the newest state, read before or not; a stale one, perhaps of a stopped daemon, is skipped."""
        is_fresh = time.monotonic() - self._t_last_s < FRESH_S
        if self._is_connected and self._socket.poll(0) != 0:
            self.next(0)
        if is_fresh and self._last is not None:
            return self._last
        return self.next(timeout_s)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
