"""`hapticd install-service`: the files of `systemd/` in place, with the program's own path in the unit.

They come with the package (as its data files) or from the source checkout. Nothing is started, and a configuration
that is there is left alone.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import HapticdError

DESTINATIONS = {
    "hapticd.service": Path("etc/systemd/system/hapticd.service"),
    "71-hapticd.rules": Path("etc/udev/rules.d/71-hapticd.rules"),
    "hapticd.sysusers.conf": Path("etc/sysusers.d/hapticd.conf"),
    "hapticd.toml": Path("etc/hapticd/hapticd.toml"),
}
KEPT = {"hapticd.toml"}  # a person's, once it is there
HIDDEN_BY_UNIT = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # ProtectHome=, PrivateTmp=

AFTERWARDS = """\
systemd-sysusers
udevadm control --reload
udevadm trigger
systemctl daemon-reload
systemctl enable --now hapticd
"""


@dataclass(frozen=True, slots=True)
class ServiceFile:
    """One file: its name in `systemd/`, where it goes below the root, and what stands in it."""

    name: str
    destination: Path
    text: str


def service_files(folder: Path | None = None, program: Path | None = None) -> tuple[ServiceFile, ...]:
    """What is to be installed from `folder` (default: where the package or the checkout has it), starting `program`
    (default: the `hapticd` beside this interpreter). Raises HapticdError."""
    folder = _folder() if folder is None else folder
    program = Path(sys.executable).with_name("hapticd") if program is None else program
    files = []
    for name, destination in DESTINATIONS.items():
        try:
            text = (folder / name).read_text(encoding="utf-8")
        except OSError as error:
            raise HapticdError(f"{folder / name}: cannot be read ({error.strerror}): install hapticd again.") from None
        if name.endswith(".service"):
            text = re.sub(r"^ExecStart=\S+", lambda _: f"ExecStart={program}", text, flags=re.MULTILINE)
        files.append(ServiceFile(name, destination, text))
    return tuple(files)


def listing(files: Sequence[ServiceFile]) -> str:
    """All files with their places, and what is to be run afterwards."""
    shown = [f"# --- /{file.destination}\n{file.text}" for file in files]
    return "\n".join([*shown, f"# --- then\n{AFTERWARDS}"])


def install(files: Sequence[ServiceFile], root: Path) -> str:
    """Write the files below `root`; what was done and what remains, as text. Raises HapticdError."""
    program = next(line.split("=")[1].split()[0] for line in _unit(files).splitlines() if line.startswith("ExecStart="))
    if program.startswith(tuple(f"{place}/" for place in HIDDEN_BY_UNIT)):
        raise HapticdError(
            f"{program}: lies where the service cannot see it: install hapticd in /opt, as systemd/README.md says."
        )
    done = []
    for file in files:
        path = root / file.destination
        if file.name in KEPT and path.exists():
            done.append(f"kept       {path}")
            continue
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(file.text, encoding="utf-8")
            path.chmod(0o644)
        except OSError as error:
            raise HapticdError(f"{path}: cannot be written ({error.strerror}): run it as root.") from None
        done.append(f"installed  {path}")
    return "\n".join([*done, "then run:", *(f"  {line}" for line in AFTERWARDS.splitlines()), ""])


def _unit(files: Sequence[ServiceFile]) -> str:
    return next(file.text for file in files if file.name.endswith(".service"))


def _folder() -> Path:
    packaged = Path(sysconfig.get_path("data"), "share", "hapticd", "systemd")
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "systemd"
