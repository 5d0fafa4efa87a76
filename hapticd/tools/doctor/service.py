"""The running daemon: whether it answers, how it is, and whether there is more than one."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import zmq

from ... import __version__
from ...config.sections import Config
from ...errors import HapticdError
from ...io.clients.runtime_dir import endpoint_path, runtime_directory
from .finding import FAIL, PASS, WARN, Finding, Patient, is_ours

SYSTEM_DIRECTORY = Path("/run/hapticd")  # of the system service
ANSWER_S = 1.5
START = "hapticd run --config F, or: sudo systemctl start hapticd"
RESTART = "sudo systemctl restart hapticd, or end that process and start `hapticd run` again"


def directories(environ: Mapping[str, str]) -> tuple[Path, ...]:
    """Where daemons of this machine may serve: this user's first."""
    known = [runtime_directory(environ), Path(f"/tmp/hapticd-{os.getuid()}")]
    if environ.get("XDG_RUNTIME_DIR"):
        known.append(Path(environ["XDG_RUNTIME_DIR"], "hapticd"))
    return tuple(dict.fromkeys([*known, SYSTEM_DIRECTORY]))


def met(config: Config, environ: Mapping[str, str]) -> Patient:
    """The patient, with the answers of the daemon that serves it, if one does."""
    if config.client.runtime_dir:
        places: tuple[Path, ...] = (Path(config.client.runtime_dir),)
    else:
        places = directories(environ)
    for place in places:
        status, version = _asked(place)
        if status is not None:
            return Patient(config, place, status, version)
    telling = (place for place in places if is_locked(place) or is_closed(place))
    return Patient(config, next(telling, places[0]))


def again(patient: Patient) -> Patient:
    """The same a moment later."""
    status, version = _asked(patient.directory)
    return replace(patient, status=status, version=version)


def _asked(directory: Path) -> tuple[Mapping[str, Any] | None, str]:
    """Status and version of the daemon there. A client would also let go of fingers as it leaves; this only asks."""
    if not _is_socket(directory / "control"):
        return None, ""
    try:
        from hapticd_client import HapticdError as ClientError
        from hapticd_client.control import Control
        from hapticd_client.endpoint import Endpoint
    except ImportError:
        return None, ""
    context = zmq.Context()
    try:
        control = Control(context, Endpoint(directory))
        try:
            hello = control.request("hello", timeout_s=ANSWER_S)
            return control.request("status", timeout_s=ANSWER_S), str(hello.get("version", ""))
        finally:
            control.close()
    except (ClientError, zmq.ZMQError):  # nobody answers, or the path is too long for a socket
        return None, ""
    finally:
        context.term()


def daemon(patient: Patient) -> Finding:
    """Whether one serves here, and answers."""
    directory = patient.directory
    try:
        control = endpoint_path(directory, "control")
    except HapticdError as error:
        return Finding(FAIL, "daemon", str(error), "export HAPTICD_RUNTIME_DIR=/tmp/hapticd")
    if patient.status is not None:
        if patient.version != __version__:
            said = f"version {patient.version} in {directory}, this program is {__version__}"
            return Finding(WARN, "daemon", said, RESTART)
        return Finding(PASS, "daemon", f"version {patient.version} answers in {directory}")
    if is_closed(directory) or (_is_socket(control) and not is_ours(control)):
        said = f"{directory} is not yours to connect to"
        return Finding(FAIL, "daemon", said, "sudo usermod -aG hapticd $USER, then log in again")
    if is_locked(directory):
        said = f"one holds {directory / 'lock'}, but does not answer"
        return Finding(FAIL, "daemon", said, f"fuser -v {directory / 'lock'} names it; {RESTART}")
    left = " (what is there was left by one that was killed, and is no hindrance)" if _is_socket(control) else ""
    return Finding(WARN, "daemon", f"none serves {directory}{left}", START)


def health(patient: Patient) -> Finding:
    """What the daemon says of itself."""
    if patient.status is None:
        return Finding(PASS, "state", "no daemon answers, so none is told")
    state = str(patient.told("state"))
    changes = patient.told("state_changes") or ()
    why = f": {changes[0].get('why')}" if changes and isinstance(changes[0], dict) else ""
    if state == "FAULT":
        return Finding(FAIL, "state", f"{state}{why}", "hapticd firmware info says why; then Client.clear_fault()")
    if state == "IDLE":
        return Finding(WARN, "state", f"{state}{why}", "see trackpad and board below")
    return Finding(PASS, "state", f"{state}{why}")


def alone(patient: Patient, environ: Mapping[str, str] = os.environ) -> Finding:
    """Whether other daemons serve elsewhere: clients would find one of them."""
    others = [place for place in directories(environ) if place != patient.directory and is_locked(place)]
    if not others:
        return Finding(PASS, "other daemons", "none")
    said = f"one serves {', '.join(map(str, others))} as well; clients find whichever comes first"
    return Finding(WARN, "other daemons", said, f"fuser -k -TERM {others[0] / 'lock'}, or set HAPTICD_RUNTIME_DIR")


def is_locked(directory: Path) -> bool:
    """A daemon lives there: it holds its lock for as long as it does, while its sockets may outlive it."""
    try:
        with (directory / "lock").open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # missing, or another user's: whether that one lives shows in whether it answers
        return False
    return False


def is_closed(directory: Path) -> bool:
    """It is there, and this user may not look into it."""
    return directory.is_dir() and not os.access(directory, os.X_OK)


def _is_socket(path: Path) -> bool:
    try:
        return path.is_socket()
    except OSError:
        return False
