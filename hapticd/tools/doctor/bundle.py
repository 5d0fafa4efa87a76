"""`hapticd doctor --bundle`: all that helps to understand a fault from afar, in one file. Nothing is sent anywhere.

Secret keys stay where they are: no file of `client.keys_dir` is taken, and what looks like one in a text is blotted
out.
"""

from __future__ import annotations

import io
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

import zmq

from ... import __version__
from ...config import loader as configuration
from ...errors import ConfigError, HapticdError
from ..record.attach import record
from .finding import Finding, Patient

RECORD_S = 10.0
LOG_LINES = 5000
LOG_WITHIN_S = 20.0
PACKAGES = ("hapticd", "hapticd-client", "hidapi", "mcap", "msgpack", "numpy", "pyserial", "pyzmq")
SECRET = re.compile(r'(secret[\w-]*"?\s*[=:]\s*)("[^"\n]*"|\S+)', re.IGNORECASE)  # as ZeroMQ's certificates write it

Record = Callable[[Path, Path | None, float | None], str]


class BundleError(ConfigError):
    """A file that cannot be the bundle."""

    exit_code = 2


def check_name(path: Path) -> None:
    """Before anything is examined. Raises BundleError."""
    if not path.name.endswith(".tar.gz"):
        raise BundleError(f"--bundle {path}: must end in .tar.gz.")
    if path.exists():
        raise BundleError(f"--bundle {path}: is there already: name another file.")
    if not path.absolute().parent.is_dir():
        raise BundleError(f"--bundle {path}: there is no folder {path.absolute().parent}: make it first.")


def collect(
    path: Path,
    patient: Patient | None,
    config_path: Path | None,
    found: Sequence[Finding],
    *,
    record: Record = record,
    log: Callable[[], str] | None = None,
) -> str:
    """Write the bundle, for its owner's eyes only; what is in it, as text. Raises BundleError."""
    from .report import as_document

    parts = {
        "doctor.txt": "".join(f"{finding}\n" for finding in found),
        "doctor.json": as_document(found),
        "versions.txt": versions(),
        "log.txt": (journal if log is None else log)(),
        **_configuration(patient, config_path),
    }
    if patient is not None and patient.status is not None:
        parts["status.json"] = json.dumps(patient.status, indent=2, default=repr)
    contents = {name: SECRET.sub(r'\1"(blotted out)"', text).encode() for name, text in parts.items()}
    recorded, why = _recording(patient, record)
    if recorded:
        contents["recording.mcap"] = recorded
    _write(path, contents)
    lines = [f"{path}: nothing was sent anywhere; look into it before you give it away. In it:"]
    lines += [f"  {name:<20} {len(data):>9} bytes" for name, data in contents.items()]
    return "\n".join([*lines, f"  {why}"])


def versions() -> str:
    """Of the program, what it runs on, and the libraries it takes."""
    lines = [
        f"hapticd {__version__}",
        f"python {sys.version.split()[0]} ({platform.python_implementation()})",
        f"system {platform.platform()}",
        f"zeromq {zmq.zmq_version()}",
    ]
    for name in PACKAGES:
        try:
            lines.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            lines.append(f"{name} is not installed")
    return "\n".join(lines) + "\n"


def journal() -> str:
    """The service's newest lines, or why there are none."""
    program = shutil.which("journalctl")
    if program is None:
        return "There is no journalctl here: send what `hapticd run` printed as well.\n"
    command = [program, "--unit", "hapticd", "--no-pager", "--output", "short-iso-precise", "--lines", str(LOG_LINES)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=LOG_WITHIN_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"journalctl gave nothing: {error}\n"
    return ended.stdout + ended.stderr


def _configuration(patient: Patient | None, config_path: Path | None) -> Mapping[str, str]:
    """The file as it stands, and what came of it."""
    parts = {}
    if config_path is not None:
        try:
            parts["hapticd.toml"] = config_path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            parts["hapticd.toml"] = f"# {config_path}: cannot be read ({error.strerror})\n"
    if patient is not None:
        parts["in-force.toml"] = configuration.render(patient.config)
    return parts


def _recording(patient: Patient | None, record: Record) -> tuple[bytes, str]:
    if patient is None or patient.status is None:
        return b"", "no recording, for no daemon answered"
    with tempfile.TemporaryDirectory(prefix="hapticd-doctor-") as folder:
        file = Path(folder, "recording.mcap")
        try:
            record(file, patient.directory, RECORD_S)
            return (
                file.read_bytes(),
                f"recording.mcap: {RECORD_S:g} s; `hapticd plot` draws it, `export` makes tables of it",
            )
        except (HapticdError, OSError) as error:
            return b"", f"no recording: {error}"


def _write(path: Path, contents: Mapping[str, bytes]) -> None:
    folder = path.name.removesuffix(".tar.gz")
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        with os.fdopen(fd, "wb") as file, tarfile.open(fileobj=file, mode="w:gz") as archive:
            for name, data in contents.items():
                entry = tarfile.TarInfo(f"{folder}/{name}")
                entry.size, entry.mtime, entry.mode = len(data), int(time.time()), 0o600
                archive.addfile(entry, io.BytesIO(data))
    except OSError as error:
        path.unlink(missing_ok=True)
        raise BundleError(f"--bundle {path}: cannot be written ({error.strerror}).") from None
