"""`hapticd doctor --bundle`: one file with the data for a remote diagnosis. Nothing is sent.

No file of `client.keys_dir` is included, and text that looks like a secret key is redacted.
"""

from __future__ import annotations

import io
import json
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path

import zmq

from ...config import loader as configuration
from ...errors import HapticdError
from ...formats.toml_file import MAX_BYTES
from ...regular_file import opened, read_bounded
from ..record import attach
from ..version import version_text
from .finding import CheckResult, System, as_document

SUFFIX = (".tar.gz",)
RECORD_S = 10.0
WAIT_S = 3.0  # for an idle plate, whose recording replays; then the recording begins in mid-session
LOG_LINES = 5000
LOG_WITHIN_S = 20.0
SECRET = re.compile(r'(secret[\w-]*"?\s*[=:]\s*)("[^"\n]*"|\S+)', re.IGNORECASE)  # as ZeroMQ's certificates write it


def collect(path: Path, system: System | None, config_path: Path | None, found: Sequence[CheckResult]) -> str:
    """Write the bundle, readable by its owner only; return a list of its contents. Raises HapticdError."""
    parts = {
        "doctor.txt": "".join(f"{finding}\n" for finding in found),
        "doctor.json": as_document(found),
        "versions.txt": versions(),
        "log.txt": journal(),
    }
    if config_path is not None:
        try:
            parts["hapticd.toml"] = read_bounded(config_path, MAX_BYTES).decode(errors="replace")
        except OSError as error:
            parts["hapticd.toml"] = f"# {config_path}: cannot be read ({error.strerror})\n"
    if system is not None:
        parts["in-force.toml"] = configuration.render(system.config)
    if system is not None and system.status is not None:
        parts["status.json"] = json.dumps(system.status, indent=2, default=repr)
    contents = {name: SECRET.sub(r'\1"(redacted)"', text).encode() for name, text in parts.items()}
    recorded, why = _recording(system)
    if recorded:
        contents["recording.mcap"] = recorded
    _write(path, contents)
    lines = [f"{path}: nothing was sent; check it before you share it. Contents:"]
    lines += [f"  {name:<20} {len(data):>9} bytes" for name, data in contents.items()]
    return "\n".join([*lines, f"  {why}"])


def versions() -> str:
    """Return the versions of the program, its platform and every installed package."""
    lines = [
        f"hapticd {version_text()}",
        f"python {sys.version.split()[0]} ({platform.python_implementation()})",
        f"system {platform.platform()}",
        f"zeromq {zmq.zmq_version()}",
        *sorted(f"{one.name} {one.version}" for one in metadata.distributions()),
    ]
    return "\n".join(lines) + "\n"


def journal() -> str:
    """Return the service's newest log lines, or the reason why there are none."""
    program = shutil.which("journalctl")
    if program is None:
        return "journalctl is not installed: send the output of `hapticd run` as well.\n"
    command = [program, "--unit", "hapticd", "--no-pager", "--output", "short-iso-precise", "--lines", str(LOG_LINES)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=LOG_WITHIN_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"journalctl failed: {error}\n"
    return ended.stdout + ended.stderr


def _recording(system: System | None) -> tuple[bytes, str]:
    if system is None or system.status is None:
        return b"", "no recording: no daemon answered"
    with tempfile.TemporaryDirectory(prefix="hapticd-doctor-") as folder:
        file = Path(folder, "recording.mcap")
        try:
            attach.record(file, system.directory, RECORD_S, wait_s=WAIT_S)
            return file.read_bytes(), f"recording.mcap: {RECORD_S:g} s; `hapticd export` makes tables and a picture"
        except (HapticdError, OSError) as error:
            return b"", f"no recording: {error}"


def _write(path: Path, contents: Mapping[str, bytes]) -> None:
    folder = path.name.removesuffix(*SUFFIX)
    with opened(path, mode=0o600) as file, tarfile.open(fileobj=file, mode="w:gz") as archive:
        for name, data in contents.items():
            entry = tarfile.TarInfo(f"{folder}/{name}")
            entry.size, entry.mtime, entry.mode = len(data), int(time.time()), 0o600
            archive.addfile(entry, io.BytesIO(data))
