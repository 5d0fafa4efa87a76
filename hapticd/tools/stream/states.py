"""Subscriber to every state of the daemon, in order: skipped states would lose the markers in them."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator

import zmq

import hapticd_client
from hapticd_client.endpoint import Endpoint, find
from hapticd_client.messages import decode_state
from hapticd_contract.states import PlateState

BACKLOG = 1000  # states queued while this process is stalled: about ten seconds
SILENT_S = 1.0  # the daemon sends a state at least ten times a second
POLL_S = 0.1


class States:
    """The `telemetry` socket, without skipping; it reconnects to a restarted daemon. A context manager."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._socket = context.socket(zmq.SUB)
        self._socket.linger = 0
        self._socket.rcvhwm = BACKLOG
        self._socket.subscribe(b"")
        endpoint.connect(self._socket, "telemetry")

    def __enter__(self) -> States:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def next(self, timeout_s: float) -> PlateState | None:
        """Return the next state, None after `timeout_s`. Raises HapticdError for one of another version."""
        return decode_state(self._socket.recv()) if self._socket.poll(round(timeout_s * 1000)) else None


def serve(take: Callable[[PlateState], None], endpoint: str | None, ended: Callable[[], bool] = lambda: False) -> None:
    """Pass every state to `take` until `ended` or KeyboardInterrupt; report a silent daemon on stderr.

    Raises hapticd_client.HapticdError for an unusable endpoint.
    """
    place = find(endpoint, os.environ)
    context = zmq.Context()
    try:
        with States(context, place) as states:
            for state in _until(states, place, ended):
                take(state)
    except KeyboardInterrupt:
        pass
    except zmq.ZMQError as error:
        raise hapticd_client.HapticdError(f"{place}: cannot be the daemon's directory ({error.strerror}).") from None
    finally:
        context.term()


def _until(states: States, place: Endpoint, ended: Callable[[], bool]) -> Iterator[PlateState]:
    t_last_s, is_silent = time.monotonic(), False
    while not ended():
        state = states.next(POLL_S)
        if state is not None:
            if is_silent:
                _report("the daemon sends states again")
            t_last_s, is_silent = time.monotonic(), False
            yield state
        elif not is_silent and time.monotonic() - t_last_s > SILENT_S:
            is_silent = True
            _report(f"no state from {place}: start a daemon (`hapticd run`), or give its directory with --endpoint")


def _report(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)
