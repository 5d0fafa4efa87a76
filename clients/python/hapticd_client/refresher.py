"""Refresher of the client's targets: repeats them so that they stay active while the client lives.

A thread with its own socket sends the newest message when it changes, and three times per time to live. Nothing is
queued: without a daemon nothing is sent, and a daemon that starts gets the newest. A refresh may overtake a request or
be overtaken; the stamp of the targets lets the daemon detect this.
"""

from __future__ import annotations

import math
import threading
import time

import zmq

from .endpoint import Endpoint

RETRY_S = 0.02  # while no daemon is connected
REFRESHES_PER_TTL = 3  # tolerates one lost message
LINGER_MS = 100  # to send the last message

REFRESHER = "hapticd-refresher"  # its thread


class Refresher:
    """Send one payload on the endpoint's socket of this name repeatedly, until `stop`."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], endpoint: Endpoint, name: str = "targets") -> None:
        self._context = context
        self._endpoint = endpoint
        self._name = name
        self._changed = threading.Condition()
        self._payload = b""
        self._period_s = math.inf
        self._t_due_s = math.inf
        self._is_stopped = False
        self._thread = threading.Thread(target=self._run, name=REFRESHER, daemon=True)
        self._thread.start()

    def send(self, payload: bytes, ttl_s: float) -> None:
        """Send this now and three times per `ttl_s`; only once if that is infinite."""
        self._replace(payload, ttl_s, delay_s=0.0)

    def keep(self, payload: bytes, ttl_s: float) -> None:
        """Refresh this three times per `ttl_s`; a request has already sent it."""
        self._replace(payload, ttl_s, delay_s=ttl_s / REFRESHES_PER_TTL)

    def stop(self) -> None:
        """Send what is due, then stop the thread."""
        with self._changed:
            self._is_stopped = True
            self._changed.notify()
        self._thread.join()

    def _replace(self, payload: bytes, ttl_s: float, delay_s: float) -> None:
        with self._changed:
            self._payload = payload
            self._period_s = ttl_s / REFRESHES_PER_TTL
            self._t_due_s = time.monotonic() + delay_s
            self._changed.notify()

    def _run(self) -> None:
        socket = self._context.socket(zmq.PUSH)
        socket.linger = LINGER_MS
        socket.immediate = True
        socket.sndhwm = 2
        self._endpoint.connect(socket, self._name)
        with self._changed:
            while True:
                left_s = self._t_due_s - time.monotonic()
                if left_s <= 0:
                    self._refresh(socket)
                elif self._is_stopped:
                    break
                else:
                    self._changed.wait(min(left_s, threading.TIMEOUT_MAX))
        socket.close()

    def _refresh(self, socket: zmq.Socket[bytes]) -> None:
        is_sent = _sent(socket, self._payload)
        self._t_due_s = time.monotonic() + (self._period_s if is_sent else RETRY_S)


def _sent(socket: zmq.Socket[bytes], payload: bytes) -> bool:
    """Send without blocking; returns False without a daemon."""
    try:
        socket.send(payload, zmq.NOBLOCK)
    except zmq.Again:
        return False
    return True
