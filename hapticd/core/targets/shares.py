"""Shares of what all clients have in common: one user may take three quarters of it, so that another finds room.

A user is who the socket says sends: names cost a client nothing, so bounds by client would bound nobody. The host's
own requests, of no user, may take all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

USER_SHARE: Final = 0.75
HOST: Final = ""  # the user of what the daemon's own process requests

UserOf = Callable[[str], str]  # a client's name: its user


def host_of(_client: str) -> str:
    """Return HOST for every client: without sockets there is one user."""
    return HOST


def left(most: float, user: str, used: float, used_by_user: float) -> float:
    """Return how much a user may still take of `most`, of which all together and this user have taken so much."""
    own = most if user == HOST else USER_SHARE * most
    return min(most - used, own - used_by_user)


def spoken(most: float, what: str, user: str) -> str:
    """Return a bound in words, for a refusal."""
    return f"{most:g} {what} at once" + ("" if user == HOST else f", one user has {USER_SHARE * most:g} of them")
