"""The daemon's ZeroMQ sockets behind the gate, for local users and for clients over TCP with a key.

All subscribers share `telemetry`, which has two inner endpoints: without keys, and for TCP with CURVE required. Each
connection to `targets` or `control` has a socket of its own, with the one or the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import zmq
from zmq.auth.asyncio import AsyncioAuthenticator

from ...errors import HapticdError
from .keys import ServerKeys
from .listeners import bind_inner, inner_path

# Socket files in the runtime directory, and ports in this order
ENDPOINTS = {"targets": zmq.PULL, "control": zmq.ROUTER, "telemetry": zmq.XPUB}

MAX_MESSAGE_BYTES = 65536  # ZeroMQ disconnects the sender of a larger one
MAX_SUBSCRIPTION_BYTES = 1024  # a subscription is one byte; the handshake has a key
HANDSHAKE_MS = 2000  # for a complete handshake; a connection without one is closed
RECEIVE_HIGH_WATER = 32  # messages per client; the rest waits in the client's buffers
SEND_HIGH_WATER = 128  # states, over a second, for a slow subscriber, which misses the next
# Pending replies to one client. ZeroMQ learns late how many were read and silently drops replies beyond the mark:
# with 16, a client that waits for each reply missed one in a few dozen.
REPLY_HIGH_WATER = 256
ZAP_DOMAIN = "hapticd"

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


class Sockets:
    """Makes the daemon's sockets behind the gate, and owns their context, their authenticator and `telemetry`."""

    def __init__(self, paths: Sequence[Path], remote: Remote | None, allow_list: AllowList | None) -> None:
        """Bind `telemetry` for the public paths of ENDPOINTS, and for `remote`'s ports.

        Raises zmq.ZMQError, HapticdError, and leaves nothing open. With `remote`, call it on the running loop, which
        the authenticator uses.
        """
        self._context: Context = zmq.Context()
        self._remote = remote
        self._authenticator = AsyncioAuthenticator(self._context)
        self.telemetry = self._context.socket(zmq.XPUB)
        try:
            if remote is not None:
                self._authenticator.start()
                self._authenticator.configure_curve_callback(ZAP_DOMAIN, credentials_provider=allow_list)
            self._bind(self.telemetry, inner_path(paths[-1]), is_remote=False)
            if remote is not None:
                self._bind(self.telemetry, inner_path(paths[-1], is_remote=True), is_remote=True)
        except (zmq.ZMQError, HapticdError):
            self.close()
            raise

    def bound(self, kind: int, path: Path, *, is_remote: bool) -> Socket:
        """Return a socket for one connection of a client. Raises zmq.ZMQError, HapticdError."""
        socket = self._context.socket(kind)
        try:
            self._bind(socket, path, is_remote=is_remote)
        except (zmq.ZMQError, HapticdError):
            socket.close()
            raise
        return socket

    def close(self) -> None:
        """Close `telemetry` and the authenticator that it uses; all others are closed before."""
        self.telemetry.close()
        if self._authenticator.zap_socket is not None:
            self._authenticator.stop()
        self._context.term()

    def _bind(self, socket: Socket, path: Path, *, is_remote: bool) -> None:
        """Options apply to later binds only, so without a key comes first."""
        socket.linger = 0
        socket.handshake_ivl = HANDSHAKE_MS
        socket.rcvhwm = RECEIVE_HIGH_WATER
        socket.sndhwm = REPLY_HIGH_WATER if socket.type == zmq.ROUTER else SEND_HIGH_WATER
        socket.maxmsgsize = MAX_SUBSCRIPTION_BYTES if socket.type == zmq.XPUB else MAX_MESSAGE_BYTES
        if is_remote and self._remote is not None:
            socket.zap_domain = ZAP_DOMAIN.encode()
            socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without an authenticator no client is admitted
            socket.curve_server = True
            socket.curve_secretkey = self._remote.keys.secret
            socket.curve_publickey = self._remote.keys.public
        bind_inner(socket, path)
