"""The listening socket of a server of pages."""

from __future__ import annotations

import socket

from ...errors import HapticdError


def bound(host: str, port: int, option: str = "--port") -> socket.socket:
    """Return a socket bound to an address of this computer, port 0: any; `option` names it. Raises HapticdError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise HapticdError(
            f"Port {port} cannot be bound ({error.strerror}): choose another with {option}, or 0 for any."
        ) from None
    return listener
