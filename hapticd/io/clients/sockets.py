"""The daemon's three ZeroMQ sockets: bound to ipc for this machine's users, and to TCP for whoever holds a key.

Both are ends of the same sockets. The order is what keeps them apart: options of a socket hold for what is bound after
them, so ipc comes first, without keys, and TCP last, with keys and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import zmq
from zmq.auth.asyncio import AsyncioAuthenticator

from .keys import ServerKeys
from .runtime_dir import masked

ENDPOINTS = ("targets", "control", "telemetry")  # socket files in the runtime directory, and ports in this order

MAX_MESSAGE_BYTES = 65536  # a larger one costs its sender the connection
MAX_SUBSCRIPTION_BYTES = 1024  # all that a subscriber has to say is one byte, and in the handshake its key
RECEIVE_HIGH_WATER = 32  # messages per client; what a flood has beyond waits in the client's own buffers
SEND_HIGH_WATER = 16  # states for a slow subscriber; it misses the next
# Replies on their way to one client. ZeroMQ hears late how many were read, and throws away in silence what goes beyond:
# with 16, one in a few dozen quick requests of a client that waits for each reply never got one.
REPLY_HIGH_WATER = 256
SOCKET_UMASK = 0o117  # owner and group may connect, others may not
ZAP_DOMAIN = "hapticd"

Context = zmq.Context[zmq.Socket[bytes]]
Socket = zmq.Socket[bytes]


@dataclass(frozen=True, slots=True)
class Remote:
    """Where clients with a key connect: `host` (an address or interface) and the first of three ports."""

    host: str
    port: int
    keys: ServerKeys


class AllowList:
    """Answers the authenticator: only the keys in `names` get in. `denied` counts the others."""

    def __init__(self, remote: Remote) -> None:
        self.denied = 0
        self._names = remote.keys.clients

    def callback(self, domain: str, key: bytes) -> bool:
        """pyzmq's question about a client's public key (Z85)."""
        is_allowed = domain == ZAP_DOMAIN and key.decode() in self._names
        self.denied += not is_allowed
        return is_allowed


@dataclass(frozen=True, slots=True)
class Sockets:
    """The three sockets in the order of ENDPOINTS, and who guards them."""

    context: Context
    targets: Socket
    control: Socket
    telemetry: Socket
    authenticator: AsyncioAuthenticator

    @property
    def all(self) -> tuple[Socket, Socket, Socket]:
        """In the order of ENDPOINTS."""
        return self.targets, self.control, self.telemetry

    def close(self) -> None:
        """Close all, and the authenticator after those that ask it."""
        for socket in self.all:
            socket.close()
        if self.authenticator.zap_socket is not None:
            self.authenticator.stop()
        self.context.term()


def bound(paths: Sequence[Path], remote: Remote | None, allow_list: AllowList | None) -> Sockets:
    """Sockets bound to the paths of ENDPOINTS, and to `remote`'s ports. Raises zmq.ZMQError, with nothing left open.

    With `remote`, call it on the running loop: the authenticator serves there.
    """
    context = zmq.Context()
    sockets = Sockets(
        context,
        context.socket(zmq.PULL),
        context.socket(zmq.ROUTER),
        context.socket(zmq.XPUB),
        AsyncioAuthenticator(context),
    )
    try:
        _bind_local(sockets, paths)
        if remote is not None:
            _bind_remote(sockets, remote, allow_list)
    except zmq.ZMQError:
        sockets.close()
        raise
    return sockets


def _bind_local(sockets: Sockets, paths: Sequence[Path]) -> None:
    with masked(SOCKET_UMASK):
        for socket, path in zip(sockets.all, paths, strict=True):
            socket.linger = 0
            socket.rcvhwm = RECEIVE_HIGH_WATER
            socket.sndhwm = REPLY_HIGH_WATER if socket is sockets.control else SEND_HIGH_WATER
            socket.maxmsgsize = MAX_SUBSCRIPTION_BYTES if socket is sockets.telemetry else MAX_MESSAGE_BYTES
            socket.bind(f"ipc://{path}")


def _bind_remote(sockets: Sockets, remote: Remote, allow_list: AllowList | None) -> None:
    sockets.authenticator.start()
    sockets.authenticator.configure_curve_callback(ZAP_DOMAIN, credentials_provider=allow_list)
    for port, socket in enumerate(sockets.all, remote.port):
        socket.zap_domain = ZAP_DOMAIN.encode()
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # no authenticator: nobody gets in, rather than everybody
        socket.curve_server = True
        socket.curve_secretkey = remote.keys.secret
        socket.curve_publickey = remote.keys.public
        socket.bind(f"tcp://{remote.host}:{port}")
