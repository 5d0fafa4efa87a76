"""`hapticd service`: the files of `systemd/`, with this program's path in the unit.

The files come from the package's data or from the source checkout. Nothing is started or stopped, and an existing
configuration is kept.
"""

from __future__ import annotations

import argparse
import re
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import HapticdError
from . import keys
from .arguments import add_command

DESTINATIONS = {
    "hapticd.service": Path("etc/systemd/system/hapticd.service"),
    "71-hapticd.rules": Path("etc/udev/rules.d/71-hapticd.rules"),
    "hapticd.sysusers.conf": Path("etc/sysusers.d/hapticd.conf"),
    "hapticd.toml": Path("etc/hapticd/hapticd.toml"),
}
KEPT = {"hapticd.toml"}  # not overwritten
HIDDEN_BY_UNIT = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # ProtectHome=, PrivateTmp=

AFTERWARDS = """\
systemd-sysusers
udevadm control --reload
udevadm trigger
systemctl daemon-reload
systemctl enable --now hapticd
"""

FIRST = "systemctl disable --now hapticd"
AFTER_REMOVAL = """\
udevadm control --reload
systemctl daemon-reload
"""


@dataclass(frozen=True, slots=True)
class ServiceFile:
    """One file: its name in `systemd/`, its destination below the root, and its text."""

    name: str
    destination: Path
    text: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    for name, command, summary in (
        ("install", _install_service, "install the unit, rules, users and configuration"),
        ("remove", _uninstall_service, "remove the unit and rules; configuration and users stay"),
    ):
        one = add_command(actions, name, summary, "--print")
        one.add_argument("--print", action="store_true", help="print the files, change nothing")
        one.add_argument("--root", type=Path, default=Path("/"), help="below this directory (default /)")
        one.set_defaults(command=command)
    summary = "create keys for clients on other machines, and manage the allow-list"
    keys.add_arguments(add_command(actions, "keys", summary, "make /etc/hapticd/keys"))


def _uninstall_service(options: argparse.Namespace) -> None:
    print(uninstall(options.root, is_print=options.print), end="")


def _install_service(options: argparse.Namespace) -> None:
    files = service_files()
    print(listing(files) if options.print else install(files, options.root), end="")


def service_files(folder: Path | None = None, program: Path | None = None) -> tuple[ServiceFile, ...]:
    """Return the files of `folder` (default: the package's or the checkout's), the unit starting `program` (default:
    the `hapticd` next to this interpreter). Raises HapticdError."""
    folder = service_folder() if folder is None else folder
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
    """Return all files with their destinations, and the commands to run afterwards."""
    shown = [f"# --- /{file.destination}\n{file.text}" for file in files]
    return "\n".join([*shown, f"# --- then\n{AFTERWARDS}"])


def install(files: Sequence[ServiceFile], root: Path) -> str:
    """Write the files below `root`; return a report with the next commands. Raises HapticdError."""
    unit = next(file.text for file in files if file.name.endswith(".service"))
    program = next(line.split("=")[1].split()[0] for line in unit.splitlines() if line.startswith("ExecStart="))
    if program.startswith(tuple(f"{place}/" for place in HIDDEN_BY_UNIT)):
        raise HapticdError(f"{program}: is hidden from the service: install hapticd in /opt, see systemd/README.md.")
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


def uninstall(root: Path, *, is_print: bool = False) -> str:
    """Remove the files below `root` but the configuration, with `is_print` none; return a report with what to do next.

    Raises HapticdError while the unit is enabled: a service that runs would lose its unit and go on.
    """
    enabled = root / "etc/systemd/system/multi-user.target.wants/hapticd.service"
    if enabled.is_symlink() and not is_print:
        raise HapticdError(f"{enabled}: the service is enabled: run `{FIRST}` before.")
    done = []
    for name, destination in DESTINATIONS.items():
        path = root / destination
        if not path.exists():
            continue
        if name in KEPT:
            done.append(f"kept       {path}")
            continue
        try:
            if not is_print:
                path.unlink()
        except OSError as error:
            raise HapticdError(f"{path}: cannot be removed ({error.strerror}): run it as root.") from None
        done.append(f"removed    {path}")
    if not done:
        return f"nothing of hapticd's service is below {root}\n"
    return "\n".join([*done, "then run:", *(f"  {line}" for line in AFTER_REMOVAL.splitlines()), ""])


def service_folder() -> Path:
    """Return the folder of the service's files: the package's, else the checkout's."""
    packaged = Path(sysconfig.get_path("data"), "share", "hapticd", "systemd")
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "systemd"
