"""Keys for clients over TCP: a directory of ZeroMQ certificates.

    hapticd.key, hapticd.key_secret   the daemon's own pair (CURVE, Z85)
    clients/NAME.key                  the public keys that may connect, each under the client's name

Secret files are readable by their owner only; one that others may read is refused.
"""

from __future__ import annotations

import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import zmq.auth
from zmq.utils import z85

from ...errors import ConfigError, HapticdError, UsageError, reason
from ...regular_file import read_bounded
from .runtime_dir import masked

DAEMON_NAME = "hapticd"
CLIENTS = "clients"  # the allow-list's directory
SECRET_UMASK = 0o077
MAX_BYTES = 1 << 16  # of a certificate, which has 400
_KEY = re.compile(rb"""^[ \t]*(public|secret)-key[ \t]*=[ \t]*["']?([^"'\s]*)""", re.MULTILINE)  # of a certificate
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,31}")  # a file name and nothing more


@dataclass(frozen=True, slots=True)
class ServerKeys:
    """The daemon's key pair and its allow-list, which maps public keys (Z85) to client names."""

    public: bytes
    secret: bytes = field(repr=False)
    clients: Mapping[str, str]


def make_pair(directory: Path, name: str) -> tuple[Path, Path]:
    """Write a new key pair and return its files, the public one first. Raises HapticdError if one exists."""
    _check_name(name)
    files = directory / f"{name}.key", directory / f"{name}.key_secret"
    for path in files:
        if path.exists():
            raise UsageError(f"{path}: exists already, and its users need it: remove it first to make a new one.")
    try:
        with masked(SECRET_UMASK):
            directory.mkdir(parents=True, exist_ok=True)
            zmq.auth.create_certificates(directory, name)
        files[0].chmod(0o644)  # the public key is for distribution
    except OSError as error:
        raise HapticdError(f"{directory}: keys cannot be written to it ({error.strerror}).") from None
    return files


def allow(directory: Path, certificate: Path) -> Path:
    """Allow the client with this public certificate, under the file's name. Returns the allow-list's file."""
    _check_name(certificate.stem)
    public, secret = read_pair(certificate)
    if secret is not None:
        raise UsageError(f"{certificate}: contains a secret key, which must stay with the client: use its .key file.")
    known = allowed(directory).get(public.decode())
    if known is not None:
        raise UsageError(f"{certificate}: this key is already allowed as {known}.")
    listed = directory / CLIENTS / f"{certificate.stem}.key"
    if listed.exists():
        raise UsageError(f"{listed}: another key has this name: rename the file, or revoke the name first.")
    try:
        listed.parent.mkdir(exist_ok=True)
        listed.write_bytes(read_bounded(certificate, MAX_BYTES))
    except OSError as error:
        raise HapticdError(f"{listed}: cannot be written ({error.strerror}).") from None
    return listed


def revoke(directory: Path, name: str) -> None:
    """Remove a client from the allow-list. Raises HapticdError if it is not on it."""
    _check_name(name)
    listed = directory / CLIENTS / f"{name}.key"
    try:
        listed.unlink()
    except OSError as error:
        raise UsageError(f"{listed}: cannot be removed ({error.strerror}): see `hapticd service keys list`.") from None


def allowed(directory: Path) -> dict[str, str]:
    """Return the allow-list, public key (Z85) to name. Raises HapticdError for an invalid file."""
    listed = sorted((directory / CLIENTS).glob("*.key"))
    return {read_pair(path)[0].decode(): path.stem for path in listed}


def load(directory: Path) -> ServerKeys:
    """Load the keys to serve TCP. Raises ConfigError, with the remedy, if something is missing."""
    path = directory / f"{DAEMON_NAME}.key_secret"
    if not path.is_file():
        raise ConfigError(f"{path}: does not exist, and TCP needs keys: run `hapticd service keys make {directory}`.")
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"{path}: other users may read this secret: run `chmod 600` on it, or make a new one.")
    try:
        public, secret = read_pair(path)
        clients = allowed(directory)
    except UsageError as error:
        raise ConfigError(str(error)) from None
    if secret is None:
        raise ConfigError(f"{path}: contains no secret key: run `hapticd service keys make` again.")
    if not clients:
        raise ConfigError(
            f"{directory / CLIENTS}: no client is allowed: `hapticd service keys allow` one, or clear client.tcp."
        )
    return ServerKeys(public, secret, clients)


def read_pair(path: Path) -> tuple[bytes, bytes | None]:
    """Return public and secret key (Z85) of a certificate. Raises HapticdError if it is invalid."""
    try:
        found = dict(_KEY.findall(read_bounded(path, MAX_BYTES)))  # ZeroMQ's own reader takes any file, and all of it
        if b"public" not in found:
            raise ValueError("it has no public key")
        public, secret = found[b"public"], found.get(b"secret")
        for key in (public, secret):
            if key is not None and len(z85.decode(key)) != 32:
                raise ValueError("a key has 40 characters")
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(f"{path}: is not a ZeroMQ certificate ({reason(error)}).") from None
    return public, secret


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise UsageError(f"{name[:40]!r}: a key's name has 1 .. 32 letters, digits, dots, dashes or underlines.")
