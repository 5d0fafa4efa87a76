"""Who goes by which name, and which of a client's messages is the newest.

A name belongs to the user who uses it, for as long as it is used. What that user says under it may arrive out of order,
for a client's two sockets overtake each other; a stamp tells which message is older, and that one is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import RequestError

MAX_NAMES = 64  # names are free to invent: what they may occupy is not
KEPT_NS = 5_000_000_000  # a name is remembered for so long at least: no message is on its way for longer


@dataclass(slots=True)
class _Client:
    user: str
    stamp: int
    t_forgotten_ns: int


class ClientRegistry:
    """The names in use. Instants are arguments in ns on one monotonic axis."""

    def __init__(self) -> None:
        self._clients: dict[str, _Client] = {}

    def __len__(self) -> int:
        return len(self._clients)

    def is_newest(self, name: str, user: str, stamp: int | None, ttl_ns: int, t_ns: int) -> bool:
        """Whether a message is at least as new as all before it of this client. One without a stamp always is.

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
        """A new client, in the place of those that are long silent."""
        if len(self._clients) >= MAX_NAMES:
            self._clients = {known: client for known, client in self._clients.items() if t_ns < client.t_forgotten_ns}
        if len(self._clients) >= MAX_NAMES:
            raise RequestError(f"{MAX_NAMES} client names are in use already: wait until one falls silent.")
        self._clients.pop(name, None)
        return _Client(user, 0, t_ns)
