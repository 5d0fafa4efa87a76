"""Checks of the running daemon: reply, state, and other daemons on this host."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import zmq

from hapticd_client import HapticdError as ClientError
from hapticd_client.control import Control
from hapticd_client.endpoint import Endpoint

from ... import __version__
from ...config.sections import Config
from ...errors import HapticdError
from ...io.clients.runtime_dir import check_own, endpoint_path, runtime_directory
from .finding import FAIL, PASS, WARN, CheckResult, System, is_accessible

SYSTEM_DIRECTORY = Path("/run/hapticd")  # of the system service
TEMPORARY = Path("/tmp")
ANSWER_S = 1.5
START = "hapticd run --config F, or: sudo systemctl start hapticd"
TOO_MUCH = ("left_out", "reports_left_out", "pauses", "dropped", "too_fast")  # counters of what came too fast
RESTART = "sudo systemctl restart hapticd, or end that process and start `hapticd run` again"


def directories(environ: Mapping[str, str]) -> tuple[Path, ...]:
    """Return the runtime directories of daemons on this host, this user's first."""
    known = [runtime_directory(environ), TEMPORARY / f"hapticd-{os.getuid()}"]
    if environ.get("XDG_RUNTIME_DIR"):
        known.append(Path(environ["XDG_RUNTIME_DIR"], "hapticd"))
    return tuple(dict.fromkeys([*known, SYSTEM_DIRECTORY]))


def find(config: Config, environ: Mapping[str, str], endpoint: str | None = None) -> System:
    """Return the system, with the replies of its daemon if one runs, at `endpoint` or where one may be."""
    places = directories(environ) if endpoint is None else (Path(endpoint),)
    for place in places:
        if _distrust(place):
            continue
        status, version = _request(place)
        if status is not None:
            return System(config, place, status, version)
    occupied = (place for place in places if is_locked(place) or is_closed(place))
    return System(config, next(occupied, places[0]))


def refreshed(system: System) -> System:
    """Return the system with the daemon's current replies."""
    status, version = _request(system.directory)
    return replace(system, status=status, version=version)


def _request(directory: Path) -> tuple[Mapping[str, Any] | None, str]:
    """Return status and version of the daemon there. Unlike a full client, this releases no fingers on exit."""
    if not _is_socket(directory / "control"):
        return None, ""
    context = zmq.Context()
    try:
        control = Control(context, Endpoint(directory))
        try:
            hello = control.request("hello", timeout_s=ANSWER_S)
            return control.request("status", timeout_s=ANSWER_S), str(hello.get("version", ""))
        finally:
            control.close()
    except (ClientError, zmq.ZMQError):  # no reply, or a path too long for a socket
        return None, ""
    finally:
        context.term()


def daemon(system: System) -> CheckResult:
    """Check that a daemon runs and answers."""
    directory = system.directory
    try:
        control = endpoint_path(directory, "control")
    except HapticdError as error:
        return CheckResult(FAIL, str(error), "export HAPTICD_RUNTIME_DIR=/tmp/hapticd")
    distrust = _distrust(directory)
    if distrust:
        return CheckResult(FAIL, distrust, f"rm -r {directory}, or set HAPTICD_RUNTIME_DIR")
    if system.status is not None:
        if system.version != __version__:
            text = f"version {system.version} in {directory}, this program is {__version__}"
            return CheckResult(WARN, text, RESTART)
        return CheckResult(PASS, f"version {system.version} answers in {directory}")
    if is_closed(directory) or (_is_socket(control) and not is_accessible(control)):
        text = f"{directory} is not accessible to this user"
        return CheckResult(FAIL, text, "sudo usermod -aG hapticd $USER, then log in again")
    if is_locked(directory):
        text = f"one holds {directory / 'lock'}, but does not answer"
        return CheckResult(FAIL, text, f"fuser -v {directory / 'lock'} shows it; {RESTART}")
    left = " (the socket there is stale, which is harmless)" if _is_socket(control) else ""
    return CheckResult(WARN, f"none runs in {directory}{left}", START)


def health(system: System) -> CheckResult:
    """Check the daemon's state."""
    if system.status is None:
        return CheckResult(PASS, "unknown: no daemon answers")
    state = str(system.reported("state"))
    changes = system.reported("state_changes") or ()
    why = f": {changes[0].get('why')}" if changes and isinstance(changes[0], dict) else ""
    if state == "FAULT":
        return CheckResult(FAIL, f"{state}{why}", "hapticd firmware info shows the cause; then Client.clear_fault()")
    if state == "IDLE":
        return CheckResult(WARN, f"{state}{why}", "see trackpad and board below")
    if failed := system.reported("touch", "failed_passes"):
        text = f"{state}{why}; {failed} passes failed since the start: in each the plate was silent"
        return CheckResult(WARN, text, "the log has the error (journalctl -u hapticd): please report it")
    left_out = _left_out(system)
    if left_out:
        text = f"{state}{why}; left out since the start, as it came faster than there was time for: {left_out}"
        return CheckResult(WARN, text, "find what sends so much; `hapticd status` shows whether it goes on")
    return CheckResult(PASS, f"{state}{why}")


def _left_out(system: System) -> str:
    """Return what of devices' reports and clients' messages was dropped for lack of time, "" for nothing."""
    sources = {**(system.reported("inputs") or {}), "clients": system.reported("clients")}
    counts = {
        f"{source} {name.replace('_', ' ')}": value
        for source, counters in sources.items()
        for name, value in (counters or {}).items()
        if name in TOO_MUCH and isinstance(value, int) and value > 0
    }
    return ", ".join(f"{value} ({name})" for name, value in counts.items())


def alone(system: System) -> CheckResult:
    """Check for other daemons on this host, which clients could find instead."""
    others = [place for place in directories(os.environ) if place != system.directory and is_locked(place)]
    if not others:
        return CheckResult(PASS, "none")
    text = f"one runs in {', '.join(map(str, others))} as well; clients connect to the first they find"
    return CheckResult(WARN, text, f"fuser -k -TERM {others[0] / 'lock'}, or set HAPTICD_RUNTIME_DIR")


def _distrust(directory: Path) -> str:
    """Return why a daemon in a directory under /tmp is not trusted, where any user may make one; "" if it is."""
    if directory.parent != TEMPORARY or not directory.exists():
        return ""
    try:
        check_own(directory)
    except HapticdError as error:
        return str(error)
    return ""


def is_locked(directory: Path) -> bool:
    """Return whether a daemon runs there: its lock ends with it, while its sockets may remain."""
    try:
        with (directory / "lock").open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # missing, or another user's, whose daemon is known by its reply only
        return False
    return False


def is_closed(directory: Path) -> bool:
    """Return whether the directory exists and this user may not enter it."""
    return directory.is_dir() and not os.access(directory, os.X_OK)


def _is_socket(path: Path) -> bool:
    try:
        return path.is_socket()
    except OSError:
        return False
