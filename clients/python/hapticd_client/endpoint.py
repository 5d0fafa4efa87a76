"""Endpoint of the daemon: a directory of ipc sockets, or a TCP address with two keys."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
from zmq.utils import z85

from .errors import HapticdError
from .regular_file import read_bounded

TEMPORARY = Path("/tmp")
SYSTEM_DIRECTORY = Path("/run/hapticd")  # of the system service
ENDPOINTS = ("targets", "control", "telemetry")  # sockets in the directory, and TCP ports in this order
LOCAL_RECONNECT_MS = 10  # libzmq's own 100 ms is long where another user's connections fill the queue of the daemon
MAX_BYTES = 1 << 16  # of a certificate, which has 400
_KEY = re.compile(rb"""^[ \t]*(public|secret)-key[ \t]*=[ \t]*["']?([^"'\s]*)""", re.MULTILINE)  # of a certificate

KeyFile = str | os.PathLike[str]
IS_POSIX = os.name == "posix"  # Windows has no users as numbers, and no permissions in a file's mode


@dataclass(frozen=True, slots=True)
class Keys:
    """The daemon's public key and this client's key pair (Z85)."""

    server: bytes
    public: bytes
    secret: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """The daemon's three sockets: in `directory`, or with `keys` at `host` from `port` on."""

    directory: Path | None = None
    host: str = ""
    port: int = 0
    keys: Keys | None = None

    def __str__(self) -> str:
        return f"tcp://{self.host}:{self.port}" if self.directory is None else str(self.directory)

    def connect(self, socket: zmq.Socket[Any], name: str) -> None:
        """Connect to the socket of this name. Raises zmq.ZMQError for an invalid address."""
        if self.directory is not None:
            socket.reconnect_ivl = LOCAL_RECONNECT_MS
            socket.connect(f"ipc://{self.directory / name}")
            return
        if self.keys is not None:
            socket.curve_serverkey = self.keys.server
            socket.curve_publickey = self.keys.public
            socket.curve_secretkey = self.keys.secret
        socket.connect(f"tcp://{self.host}:{self.port + ENDPOINTS.index(name)}")


def find(
    endpoint: str | os.PathLike[str] | None,
    environ: Mapping[str, str],
    server_key: KeyFile | None = None,
    own_key: KeyFile | None = None,
) -> Endpoint:
    """Return the endpoint for the arguments of `Client`. Raises HapticdError if address and keys do not match."""
    text = None if endpoint is None else os.fspath(endpoint)
    if text is None or not text.startswith("tcp://"):
        if server_key is not None or own_key is not None:
            raise HapticdError("Keys need a tcp:// endpoint: give one, or omit the keys.")
        if not IS_POSIX:
            raise HapticdError("No daemon runs on this system: give the tcp:// endpoint of one, with two keys.")
        return Endpoint(directory(endpoint, environ))
    host, _, port = text.removeprefix("tcp://").rpartition(":")
    if not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= 65533):
        raise HapticdError(f"{text}: must be an address and a port, such as tcp://192.168.7.1:7410.")
    if server_key is None or own_key is None:
        raise HapticdError(f"{text}: needs two keys, server_key (the daemon's .key) and own_key (your .key_secret).")
    public, secret = _own_pair(Path(own_key))
    return Endpoint(host=host, port=int(port), keys=Keys(_certificate(Path(server_key))[0], public, secret))


def default_directory(environ: Mapping[str, str]) -> Path:
    """Return $HAPTICD_RUNTIME_DIR, else the first directory with sockets, this user's before the system's.

    Raises HapticdError if the only one is in /tmp and not this user's alone: anybody may have put a daemon there.
    """
    if environ.get("HAPTICD_RUNTIME_DIR"):
        return Path(environ["HAPTICD_RUNTIME_DIR"]).absolute()
    candidates = []
    if environ.get("RUNTIME_DIRECTORY"):
        candidates.append(Path(environ["RUNTIME_DIRECTORY"].split(":")[0]))
    if environ.get("XDG_RUNTIME_DIR"):
        candidates.append(Path(environ["XDG_RUNTIME_DIR"], "hapticd"))
    temporary = TEMPORARY / f"hapticd-{os.getuid()}"
    candidates += [temporary, SYSTEM_DIRECTORY]
    found = [path for path in candidates if _has_socket(path)]
    if temporary in found and not _is_own(temporary):
        found.remove(temporary)
        if not found:
            raise HapticdError(
                f"{temporary}: other users may have made it, so a daemon there is not trusted: remove it, or set "
                "HAPTICD_RUNTIME_DIR."
            )
    return found[0] if found else candidates[0]


def _is_own(path: Path) -> bool:
    """Return whether the directory is no link, is this user's, and others may not write to it."""
    status = path.lstat()
    is_directory = stat.S_ISDIR(status.st_mode)
    return is_directory and status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def directory(endpoint: str | os.PathLike[str] | None, environ: Mapping[str, str]) -> Path:
    """Return the directory of an endpoint, with or without `ipc://`."""
    if endpoint is None:
        return default_directory(environ)
    return Path(os.fspath(endpoint).removeprefix("ipc://")).absolute()


def _has_socket(path: Path) -> bool:
    try:
        return (path / "control").is_socket()
    except PermissionError:  # another user's directory
        return False


def _own_pair(path: Path) -> tuple[bytes, bytes]:
    """Load this client's key pair; refused if other users can read the secret."""
    public, secret = _certificate(path)
    if secret is None:
        raise HapticdError(f"{path}: contains no secret key: own_key is your .key_secret file.")
    if IS_POSIX and path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise HapticdError(f"{path}: other users may read this secret: run `chmod 600` on it, or make a new one.")
    return public, secret


def _certificate(path: Path) -> tuple[bytes, bytes | None]:
    try:
        found = dict(_KEY.findall(read_bounded(path, MAX_BYTES)))  # ZeroMQ's own reader takes any file, and all of it
        if b"public" not in found:
            raise ValueError("it has no public key")
        public, secret = found[b"public"], found.get(b"secret")
        for key in (public, secret):
            if key is not None and len(z85.decode(key)) != 32:
                raise ValueError("a key has 40 characters")
    except (OSError, ValueError, KeyError) as error:
        reason = getattr(error, "strerror", None) or error
        raise HapticdError(f"{path}: is not a ZeroMQ certificate ({reason}).") from None
    return public, secret
