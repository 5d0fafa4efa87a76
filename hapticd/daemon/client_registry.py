"""Client-name ownership and message order.

A name belongs to the user who uses it, for as long as it is used. A client's messages may arrive out of order, because
it has two sockets; its stamps order them, and an older message is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import RequestError

MAX_NAMES = 64  # names cost a client nothing, so their number is bounded
KEPT_NS = 5_000_000_000  # a name is kept at least this long: no message is under way for longer


@dataclass(slots=True)
class _Client:
    user: str
    stamp: int
    t_forgotten_ns: int


class ClientRegistry:
    """The names in use. Instants are arguments in ns on one monotonic axis."""

    def __init__(self) -> None:
        self._clients: dict[str, _Client] = {}

    def is_newest(self, name: str, user: str, stamp: int | None, ttl_ns: int, t_ns: int) -> bool:
        """Return whether a message is at least as new as all earlier ones of this client. One without a stamp always
        is.

        Raises RequestError where the name is another user's, or there is no room for one more.
        """
        client = self._clients.get(name)
        if client is None or t_ns >= client.t_forgotten_ns:
            client = self._clients[name] = self._newcomer(name, user, t_ns)
        if client.user != user:
            raise RequestError(f"The client name {name!r} is in use by {client.user}: choose another.")
        if stamp is not None and stamp < client.stamp:
            return False
        client.stamp = client.stamp if stamp is None else stamp
        client.t_forgotten_ns = max(client.t_forgotten_ns, t_ns + max(ttl_ns, KEPT_NS))
        return True

    def _newcomer(self, name: str, user: str, t_ns: int) -> _Client:
        """Register a client; expired names make room."""
        if len(self._clients) >= MAX_NAMES:
            self._clients = {known: client for known, client in self._clients.items() if t_ns < client.t_forgotten_ns}
        if len(self._clients) >= MAX_NAMES:
            raise RequestError(f"The daemon knows {MAX_NAMES} client names, its most: wait until one falls silent.")
        self._clients.pop(name, None)
        return _Client(user, 0, t_ns)
