"""Receivers of the plate's states: the newest one, so that a slow reader never lags, or every event in order."""

from __future__ import annotations

import math
import time

import zmq

from hapticd_contract.states import PlateEvent, PlateState

from .endpoint import Endpoint
from .errors import DaemonGoneError
from .messages import decode_state

FRESH_S = 0.25  # the daemon sends a state at least ten times a second
BACKLOG = 4096  # states that wait for a reader of events: some 40 s


class _Subscription:
    """A `telemetry` socket, connected on first use: the daemon builds states only for subscribers."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self._socket = context.socket(zmq.SUB)
        self._socket.linger = 0
        self._is_connected = False

    def connect(self) -> None:
        """Subscribe, once."""
        if not self._is_connected:
            self._socket.subscribe(b"")
            self._endpoint.connect(self._socket, "telemetry")
            self._is_connected = True

    def _receive(self, timeout_s: float) -> PlateState:
        if self._socket.poll(math.ceil(timeout_s * 1000)) == 0:
            raise DaemonGoneError(f"No state from {self._endpoint} for {timeout_s:g} s: check that hapticd is running.")
        return decode_state(self._socket.recv())

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Telemetry(_Subscription):
    """The newest state of one client; older ones are dropped."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        super().__init__(context, endpoint)
        self._socket.conflate = True
        self._t_last_s = -math.inf
        self._last: PlateState | None = None

    def next(self, timeout_s: float) -> PlateState:
        """Return the newest unread state. Raises DaemonGoneError after the timeout."""
        self.connect()
        self._last = self._receive(timeout_s)
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


class EventReader(_Subscription):
    """Every event, in order: no state is skipped. A reader that is away for longer than the backlog loses events, which
    their numbers show."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        super().__init__(context, endpoint)
        self._socket.rcvhwm = BACKLOG

    def restart(self) -> None:
        """Drop what was queued: events from now on are kept for `next`."""
        self.connect()
        while self._socket.poll(0) != 0:
            self._socket.recv()

    def next(self, timeout_s: float) -> tuple[PlateEvent, ...]:
        """Return the events of the next state, often none. Raises DaemonGoneError after the timeout."""
        return self._receive(timeout_s).events
