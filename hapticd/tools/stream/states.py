"""Subscriber to every state of the daemon, in order: skipped states would lose the markers in them."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable

import zmq

import hapticd_client
from hapticd_client.endpoint import find
from hapticd_client.messages import decode_state
from hapticd_contract.states import PlateState

BACKLOG = 1000  # states queued while this process is stalled: about ten seconds
SILENT_S = 1.0  # the daemon sends a state at least ten times a second
POLL_S = 0.1


def serve(take: Callable[[PlateState], None], endpoint: str | None, ended: Callable[[], bool] = lambda: False) -> None:
    """Pass every state to `take` until `ended` or KeyboardInterrupt, also those of a restarted daemon; report a silent
    one on stderr.

    Raises hapticd_client.HapticdError for an unusable endpoint, or a state of another version.
    """
    place = find(endpoint, os.environ)
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.linger = 0
        socket.rcvhwm = BACKLOG
        socket.subscribe(b"")
        try:
            place.connect(socket, "telemetry")
        except zmq.ZMQError as error:
            raise hapticd_client.HapticdError(
                f"{place}: cannot be the daemon's directory ({error.strerror})."
            ) from None
        t_last_s, is_silent = time.monotonic(), False
        try:
            while not ended():
                if socket.poll(round(POLL_S * 1000)):
                    if is_silent:
                        _report("the daemon sends states again")
                    t_last_s, is_silent = time.monotonic(), False
                    take(decode_state(socket.recv()))
                elif not is_silent and time.monotonic() - t_last_s > SILENT_S:
                    is_silent = True
                    _report(f"no state from {place}: start a daemon (`hapticd run`), or give its directory: --endpoint")
        except KeyboardInterrupt:
            return


def _report(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)
