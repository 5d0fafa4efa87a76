"""The runtime directory: location, ownership and lock of the daemon's ipc sockets."""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from ...errors import AlreadyRunningError, HapticdError

MAX_SOCKET_PATH_BYTES = 107  # sun_path of unix(7), less its final zero


def runtime_directory(environ: Mapping[str, str]) -> Path:
    """Return $HAPTICD_RUNTIME_DIR, systemd's $RUNTIME_DIRECTORY, $XDG_RUNTIME_DIR/hapticd or /tmp/hapticd-UID."""
    if environ.get("HAPTICD_RUNTIME_DIR"):
        return Path(environ["HAPTICD_RUNTIME_DIR"]).absolute()
    if environ.get("RUNTIME_DIRECTORY"):
        return Path(environ["RUNTIME_DIRECTORY"].split(":")[0])  # systemd joins several with colons
    if environ.get("XDG_RUNTIME_DIR"):
        return Path(environ["XDG_RUNTIME_DIR"], "hapticd")
    return Path(f"/tmp/hapticd-{os.getuid()}")


def own_directory(path: Path) -> None:
    """Create the directory if it is missing. Raises HapticdError if others own it or may write to it.

    A link is followed only if root or this user created it: systemd links a dynamic user's directory.
    """
    try:
        path.mkdir(mode=0o750, exist_ok=True)
    except FileNotFoundError:
        raise HapticdError(
            f"{path.parent}: does not exist, so {path.name} cannot be created in it: create it first."
        ) from None
    except OSError as error:
        raise HapticdError(
            f"{path}: cannot be used as runtime directory ({error.strerror}): set HAPTICD_RUNTIME_DIR."
        ) from None
    check_own(path)


def check_own(path: Path) -> None:
    """Raise HapticdError if others own the directory or may write to it: its sockets would be anybody's."""
    try:
        creator, status = path.lstat().st_uid, path.stat()
    except OSError as error:
        raise HapticdError(
            f"{path}: cannot be used as runtime directory ({error.strerror}): set HAPTICD_RUNTIME_DIR."
        ) from None
    if status.st_uid != os.geteuid() or creator not in (0, os.geteuid()):
        raise HapticdError(
            f"{path}: belongs to another user: remove it, or set HAPTICD_RUNTIME_DIR to your own directory."
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise HapticdError(f"{path}: other users may write to it: run `chmod go-w` on it.")


def endpoint_path(directory: Path, name: str) -> Path:
    """Return the socket file of one endpoint. Raises HapticdError if its path is too long for a socket."""
    path = directory / name
    length = len(os.fsencode(path))
    if length > MAX_SOCKET_PATH_BYTES:
        raise HapticdError(
            f"{path}: the path has {length} bytes, a socket allows {MAX_SOCKET_PATH_BYTES}: "
            "set HAPTICD_RUNTIME_DIR to a shorter directory."
        )
    return path


def locked(path: Path) -> int:
    """Lock the file until it is closed; done before binding, which would take over a running daemon's sockets."""
    try:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise HapticdError(f"{path}: cannot be opened ({error.strerror}): check its owner.") from None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise AlreadyRunningError(
            f"Another hapticd serves {path.parent}: stop it, or set HAPTICD_RUNTIME_DIR to another directory."
        ) from None
    return fd


@contextmanager
def masked(umask: int) -> Iterator[None]:
    """Set the umask while the context is active."""
    before = os.umask(umask)
    try:
        yield
    finally:
        os.umask(before)
