"""Where the daemon is: a directory of ipc sockets, found by the daemon's own rule."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

SYSTEM_DIRECTORY = Path("/run/hapticd")  # of the system service


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
