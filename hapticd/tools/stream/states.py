"""Every state that the daemon tells, in order: a client that skips states would skip the markers in them."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator

import zmq

import hapticd_client
from hapticd_client.endpoint import Endpoint, find
from hapticd_client.messages import PlateState, decode_state

WAITING = 1000  # states while this process is kept from its work: some ten seconds of them
SILENT_S = 1.0  # the daemon sends a state at least ten times a second
POLL_S = 0.1


class States:
    """The `telemetry` socket, read whole. A daemon that goes is waited for. A context manager."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint) -> None:
        self._socket = context.socket(zmq.SUB)
        self._socket.linger = 0
        self._socket.rcvhwm = WAITING
        self._socket.subscribe(b"")
        endpoint.connect(self._socket, "telemetry")

    def __enter__(self) -> States:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def next(self, timeout_s: float) -> PlateState | None:
        """The next state, None where none came in time. Raises HapticdError for what is none of this version."""
        return decode_state(self._socket.recv()) if self._socket.poll(round(timeout_s * 1000)) else None


def serve(take: Callable[[PlateState], None], endpoint: str | None, ended: Callable[[], bool] = lambda: False) -> None:
    """Hand every state to `take` until `ended` or KeyboardInterrupt; says on stderr when the daemon is silent.

    Raises hapticd_client.HapticdError for an endpoint that cannot be one.
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
                _say("the daemon is there again")
            t_last_s, is_silent = time.monotonic(), False
            yield state
        elif not is_silent and time.monotonic() - t_last_s > SILENT_S:
            is_silent = True
            _say(f"no state comes from {place}: start a daemon (`hapticd run`), or name its directory with --endpoint")


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)
