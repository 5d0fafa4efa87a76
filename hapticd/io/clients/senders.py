"""Senders of client messages: their user, by the kernel (ipc) or the authenticated key (TCP), and their rate limit."""

from __future__ import annotations

from collections.abc import Mapping

import zmq

RATE_HZ = 500.0  # messages of one connection; the plate is updated 90 times a second
BURST = 100  # messages at once after a pause
UNKNOWN = "an unknown user"


def remote_user(frame: zmq.Frame, key_names: Mapping[str, str]) -> str:
    """Return the sender of a frame received over TCP; `key_names` maps the allowed public keys (Z85) to names.

    libzmq keeps the User-Id that the authenticator assigned, whatever the client claims.
    """
    try:
        name = key_names.get(str(frame.get("User-Id")))
    except zmq.ZMQError:  # it has none
        name = None
    return UNKNOWN if name is None else f"key {name}"


class RateLimiter:
    """Token bucket: admits RATE_HZ messages, BURST at once."""

    def __init__(self, t_s: float) -> None:
        self._tokens, self._t_s = float(BURST), t_s

    def admit(self, t_s: float) -> bool:
        """Return whether there is a token, and take it."""
        self._tokens = min(self._tokens + max(t_s - self._t_s, 0.0) * RATE_HZ, BURST)
        self._t_s = t_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
