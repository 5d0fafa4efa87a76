"""The daemon's three ZeroMQ sockets, bound to ipc for local users and to TCP for clients with a key.

Each socket has both endpoints. Socket options apply to later binds only, so ipc is bound first without keys, and TCP
last with CURVE required.
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

MAX_MESSAGE_BYTES = 65536  # ZeroMQ disconnects the sender of a larger one
MAX_SUBSCRIPTION_BYTES = 1024  # a subscription is one byte; the handshake has a key
RECEIVE_HIGH_WATER = 32  # messages per client; the rest waits in the client's buffers
SEND_HIGH_WATER = 16  # states for a slow subscriber, which misses the next
# Pending replies to one client. ZeroMQ learns late how many were read and silently drops replies beyond the mark:
# with 16, a client that waits for each reply missed one in a few dozen.
REPLY_HIGH_WATER = 256
SOCKET_UMASK = 0o117  # owner and group may connect, others may not
ZAP_DOMAIN = "hapticd"

Context = zmq.Context[zmq.Socket[bytes]]
Socket = zmq.Socket[bytes]


@dataclass(frozen=True, slots=True)
class Remote:
    """TCP endpoint for clients with a key: `host` (an address or interface) and the first of three ports."""

    host: str
    port: int
    keys: ServerKeys


class AllowList:
    """Allow-list for the authenticator: admits the keys of `remote`. `denied` counts the others."""

    def __init__(self, remote: Remote) -> None:
        self.denied = 0
        self._names = remote.keys.clients

    def callback(self, domain: str, key: bytes) -> bool:
        """Return whether a client with this public key (Z85) may connect; called by pyzmq."""
        is_allowed = domain == ZAP_DOMAIN and key.decode() in self._names
        self.denied += not is_allowed
        return is_allowed


@dataclass(frozen=True, slots=True)
class Sockets:
    """The three sockets in the order of ENDPOINTS, and their authenticator."""

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
        """Close the sockets, then the authenticator that they use."""
        for socket in self.all:
            socket.close()
        if self.authenticator.zap_socket is not None:
            self.authenticator.stop()
        self.context.term()


def bound(paths: Sequence[Path], remote: Remote | None, allow_list: AllowList | None) -> Sockets:
    """Bind sockets to the paths of ENDPOINTS and to `remote`'s ports. Raises zmq.ZMQError and leaves nothing open.

    With `remote`, call it on the running loop, which the authenticator uses.
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
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without an authenticator no client is admitted
        socket.curve_server = True
        socket.curve_secretkey = remote.keys.secret
        socket.curve_publickey = remote.keys.public
        socket.bind(f"tcp://{remote.host}:{port}")
