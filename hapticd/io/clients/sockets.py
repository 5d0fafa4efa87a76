"""The daemon's three ZeroMQ sockets behind the gate, for local users and for clients over TCP with a key.

Each socket has two inner endpoints. Socket options apply to later binds only, so the local one is bound first without
keys, and the one for TCP last with CURVE required.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import zmq
from zmq.auth.asyncio import AsyncioAuthenticator

from ...errors import HapticdError
from .gate import UNREAD_REPLIES, Door, Gate
from .keys import ServerKeys
from .listeners import bind_inner, inner_path, local_listener, remote_listener

ENDPOINTS = ("targets", "control", "telemetry")  # socket files in the runtime directory, and ports in this order

MAX_MESSAGE_BYTES = 65536  # ZeroMQ disconnects the sender of a larger one
MAX_SUBSCRIPTION_BYTES = 1024  # a subscription is one byte; the handshake has a key
HANDSHAKE_MS = 2000  # for a complete handshake; a connection without one is closed
RECEIVE_HIGH_WATER = 32  # messages per client; the rest waits in the client's buffers
SEND_HIGH_WATER = 128  # states, over a second, for a slow subscriber, which misses the next
# Pending replies to one client. ZeroMQ learns late how many were read and silently drops replies beyond the mark:
# with 16, a client that waits for each reply missed one in a few dozen.
REPLY_HIGH_WATER = 256
ZAP_DOMAIN = "hapticd"
TELEMETRY_TOPICS = frozenset({b""})

Context = zmq.Context[zmq.Socket[bytes]]
Socket = zmq.Socket[bytes]


@dataclass(frozen=True, slots=True)
class Remote:
    """TCP endpoint for clients with a key: `host` (an address, or "*") and the first of three ports."""

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
    """Bind sockets behind the gate, for the public paths of ENDPOINTS and for `remote`'s ports.

    Raises zmq.ZMQError and leaves nothing open. With `remote`, call it on the running loop, which the authenticator
    uses.
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
            _bind_remote(sockets, paths, remote, allow_list)
    except (zmq.ZMQError, HapticdError):
        sockets.close()
        raise
    return sockets


def open_doors(gate: Gate, paths: Sequence[Path], remote: Remote | None) -> None:
    """Accept clients at the public paths of ENDPOINTS and at `remote`'s ports. Raises HapticdError, OSError."""
    for index, path in enumerate(paths):
        topics = TELEMETRY_TOPICS if path.name == "telemetry" else None
        most_unread = UNREAD_REPLIES if path.name == "control" else None
        gate.open(Door(local_listener(path), inner_path(path), topics, most_unread))
        if remote is not None:
            listener = remote_listener(remote.host, remote.port + index)
            gate.open(Door(listener, inner_path(path, is_remote=True), topics, most_unread))


def _bind_local(sockets: Sockets, paths: Sequence[Path]) -> None:
    for socket, path in zip(sockets.all, paths, strict=True):
        socket.linger = 0
        socket.handshake_ivl = HANDSHAKE_MS
        socket.rcvhwm = RECEIVE_HIGH_WATER
        socket.sndhwm = REPLY_HIGH_WATER if socket is sockets.control else SEND_HIGH_WATER
        socket.maxmsgsize = MAX_SUBSCRIPTION_BYTES if socket is sockets.telemetry else MAX_MESSAGE_BYTES
        bind_inner(socket, inner_path(path))


def _bind_remote(sockets: Sockets, paths: Sequence[Path], remote: Remote, allow_list: AllowList | None) -> None:
    sockets.authenticator.start()
    sockets.authenticator.configure_curve_callback(ZAP_DOMAIN, credentials_provider=allow_list)
    for path, socket in zip(paths, sockets.all, strict=True):
        socket.zap_domain = ZAP_DOMAIN.encode()
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without an authenticator no client is admitted
        socket.curve_server = True
        socket.curve_secretkey = remote.keys.secret
        socket.curve_publickey = remote.keys.public
        bind_inner(socket, inner_path(path, is_remote=True))
