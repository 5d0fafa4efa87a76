"""Where the daemon is: a directory of ipc sockets, found by the daemon's own rule, or a TCP address and two keys."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import zmq
import zmq.auth
from zmq.utils import z85

from .errors import HapticdError

SYSTEM_DIRECTORY = Path("/run/hapticd")  # of the system service
ENDPOINTS = ("targets", "control", "telemetry")  # sockets in the directory, and TCP ports in this order

KeyFile = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class Keys:
    """The daemon's public key and this client's own pair (Z85)."""

    server: bytes
    public: bytes
    secret: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A daemon's three sockets: in `directory`, or where `keys` are given at `host` from `port` on."""

    directory: Path | None = None
    host: str = ""
    port: int = 0
    keys: Keys | None = None

    def __str__(self) -> str:
        return f"tcp://{self.host}:{self.port}" if self.directory is None else str(self.directory)

    def connect(self, socket: zmq.Socket[bytes], name: str) -> None:
        """Connect to the socket of this name. Raises zmq.ZMQError for an address that cannot be one."""
        if self.directory is not None:
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
    """What `Client` is given, understood. Raises HapticdError where address and keys do not belong together."""
    text = None if endpoint is None else os.fspath(endpoint)
    if text is None or not text.startswith("tcp://"):
        if server_key is not None or own_key is not None:
            raise HapticdError("Keys are for daemons on other machines: give a tcp:// endpoint with them.")
        return Endpoint(directory(endpoint, environ))
    host, _, port = text.removeprefix("tcp://").rpartition(":")
    if not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= 65533):
        raise HapticdError(f"{text}: must be an address and a port, such as tcp://192.168.7.1:7410.")
    if server_key is None or own_key is None:
        raise HapticdError(f"{text}: needs two keys, server_key (the daemon's .key) and own_key (your .key_secret).")
    public, secret = _own_pair(Path(own_key))
    return Endpoint(host=host, port=int(port), keys=Keys(_certificate(Path(server_key))[0], public, secret))


def default_directory(environ: Mapping[str, str]) -> Path:
    """$HAPTICD_RUNTIME_DIR, else where a daemon's sockets are: this user's daemon before the system's."""
    if environ.get("HAPTICD_RUNTIME_DIR"):
        return Path(environ["HAPTICD_RUNTIME_DIR"]).absolute()
    candidates = []
    if environ.get("RUNTIME_DIRECTORY"):
        candidates.append(Path(environ["RUNTIME_DIRECTORY"].split(":")[0]))
    if environ.get("XDG_RUNTIME_DIR"):
        candidates.append(Path(environ["XDG_RUNTIME_DIR"], "hapticd"))
    candidates += [Path(f"/tmp/hapticd-{os.getuid()}"), SYSTEM_DIRECTORY]
    return next((path for path in candidates if _has_socket(path)), candidates[0])


def directory(endpoint: str | os.PathLike[str] | None, environ: Mapping[str, str]) -> Path:
    """The directory that an endpoint names: itself, or after `ipc://`."""
    if endpoint is None:
        return default_directory(environ)
    return Path(os.fspath(endpoint).removeprefix("ipc://")).absolute()


def _has_socket(path: Path) -> bool:
    try:
        return (path / "control").is_socket()
    except PermissionError:  # a directory that is not ours to look into
        return False


def _own_pair(path: Path) -> tuple[bytes, bytes]:
    """This client's pair. A secret that others can read would let them be this client, so it is not used."""
    public, secret = _certificate(path)
    if secret is None:
        raise HapticdError(f"{path}: holds no secret: own_key is your .key_secret file.")
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise HapticdError(f"{path}: others may open it, so it is no secret: run `chmod 600` on it, or make a new one.")
    return public, secret


def _certificate(path: Path) -> tuple[bytes, bytes | None]:
    try:
        public, secret = zmq.auth.load_certificate(path)
        for key in (public, secret):
            if key is not None and len(z85.decode(key)) != 32:
                raise ValueError("a key has 40 characters")
    except (OSError, ValueError, KeyError) as error:
        raise HapticdError(f"{path}: is not a ZeroMQ certificate ({error}).") from None
    return public, secret
