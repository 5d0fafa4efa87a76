"""Public listeners in front of the gate, and the inner paths behind it."""

from __future__ import annotations

import socket
from pathlib import Path

import zmq

from ...errors import HapticdError
from .runtime_dir import masked

SOCKET_UMASK = 0o117  # owner and group may connect, others may not
INNER_UMASK = 0o177  # the owner alone
# Connections that wait to be accepted. Where they are full, a local client tries again after 10 ms (libzmq's default:
# 100 ms) and does better with a short queue; over TCP it tries again after 1 s.
LOCAL_BACKLOG, REMOTE_BACKLOG = 128, 1024


def inner_path(path: Path, *, is_remote: bool = False) -> Path:
    """Return where ZeroMQ listens behind the gate for the clients of a public socket; not a longer path than that."""
    return path.with_name(f".{path.name[:4]}{'-r' if is_remote else ''}")


def bind_inner(to: zmq.Socket[bytes], path: Path) -> None:
    """Bind a ZeroMQ socket to an inner path, which only this user may open. Raises HapticdError, zmq.ZMQError."""
    remove_socket(path)
    with masked(INNER_UMASK):
        to.bind(f"ipc://{path}")


def local_listener(path: Path) -> socket.socket:
    """Listen at a socket file, in place of one that a killed daemon left. Raises HapticdError, OSError."""
    remove_socket(path)
    listener = socket.socket(socket.AF_UNIX)
    try:
        with masked(SOCKET_UMASK):
            listener.bind(str(path))
        listener.listen(LOCAL_BACKLOG)
    except OSError:
        listener.close()
        raise
    listener.setblocking(False)
    return listener


def remote_listener(host: str, port: int) -> socket.socket:
    """Listen at a TCP address; "*" is every one of IPv4. Raises OSError."""
    address = "" if host == "*" else host.strip("[]")
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.create_server((address, port), family=family, backlog=REMOTE_BACKLOG)
    listener.setblocking(False)
    return listener


def close_listener(listener: socket.socket) -> None:
    """Close a listener, and remove its socket file if it has one."""
    name = listener.getsockname()
    listener.close()
    if isinstance(name, str):
        Path(name).unlink(missing_ok=True)


def remove_socket(path: Path) -> None:
    """Remove a socket file if there is one. Raises HapticdError for a file of another kind, which is not ours."""
    if path.is_socket():
        path.unlink()
    elif path.is_symlink() or path.exists():
        raise HapticdError(f"{path}: is not a socket, so clients cannot be served here: move it away.")
