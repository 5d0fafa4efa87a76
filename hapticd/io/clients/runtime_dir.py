"""Where the daemon meets its clients: the directory of its ipc sockets, which nobody else may have put there, and its
lock, which one daemon at a time holds."""

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
    """$HAPTICD_RUNTIME_DIR, else systemd's $RUNTIME_DIRECTORY, else $XDG_RUNTIME_DIR/hapticd, else one in /tmp."""
    if environ.get("HAPTICD_RUNTIME_DIR"):
        return Path(environ["HAPTICD_RUNTIME_DIR"]).absolute()
    if environ.get("RUNTIME_DIRECTORY"):
        return Path(environ["RUNTIME_DIRECTORY"].split(":")[0])  # systemd joins several with colons
    if environ.get("XDG_RUNTIME_DIR"):
        return Path(environ["XDG_RUNTIME_DIR"], "hapticd")
    return Path(f"/tmp/hapticd-{os.getuid()}")


def own_directory(path: Path) -> None:
    """Make the directory where it is missing; refuse one that another user owns or anybody may write to.

    A link is followed only where its maker is trusted: systemd links a dynamic user's directory.
    """
    try:
        path.mkdir(mode=0o750, exist_ok=True)
        made_by, status = path.lstat().st_uid, path.stat()
    except FileNotFoundError:
        raise HapticdError(
            f"{path.parent}: is missing, so {path.name} cannot be made in it: create it first."
        ) from None
    except OSError as error:
        raise HapticdError(
            f"{path}: cannot be the runtime directory ({error.strerror}): set HAPTICD_RUNTIME_DIR."
        ) from None
    if status.st_uid != os.geteuid() or made_by not in (0, os.geteuid()):
        raise HapticdError(
            f"{path}: belongs to another user: remove it, or set HAPTICD_RUNTIME_DIR to a directory of yours."
        )
    if status.st_mode & stat.S_IWOTH:
        raise HapticdError(f"{path}: anybody may write to it: take that right away with `chmod o-w`.")


def endpoint_path(directory: Path, name: str) -> Path:
    """The socket file of one endpoint. Raises HapticdError where the system has no room for so long a path."""
    path = directory / name
    length = len(os.fsencode(path))
    if length > MAX_SOCKET_PATH_BYTES:
        raise HapticdError(
            f"{path}: has {length} bytes, a socket's path has at most {MAX_SOCKET_PATH_BYTES}: "
            "set HAPTICD_RUNTIME_DIR to a shorter directory."
        )
    return path


def locked(path: Path) -> int:
    """The lock file, held until closed. It comes first: binding would steal a running daemon's sockets in silence."""
    try:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise HapticdError(f"{path}: cannot be opened ({error.strerror}): check who owns it.") from None
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
    """Files made inside lack these rights from their first moment on."""
    before = os.umask(umask)
    try:
        yield
    finally:
        os.umask(before)
