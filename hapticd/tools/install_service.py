"""`hapticd service`: the files of `systemd/`, with this program's path in the unit.

The files come from the package's data or from the source checkout. Nothing is started or stopped, and an existing
configuration is kept.
"""

from __future__ import annotations

import argparse
import re
import sys
import sysconfig
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import HapticdError
from . import keys
from .arguments import add_command

UNIT = "hapticd.service"
DESTINATIONS = {
    UNIT: Path("etc/systemd/system/hapticd.service"),
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


Files = Mapping[str, str]  # names in `systemd/`, and their texts


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


def service_files(folder: Path | None = None, program: Path | None = None) -> Files:
    """Return the files of `folder` (default: the package's or the checkout's), the unit starting `program` (default:
    the `hapticd` next to this interpreter). Raises HapticdError."""
    folder = service_folder() if folder is None else folder
    program = Path(sys.executable).with_name("hapticd") if program is None else program
    try:
        files = {name: (folder / name).read_text(encoding="utf-8") for name in DESTINATIONS}
    except OSError as error:
        raise HapticdError(f"{error.filename}: cannot be read ({error.strerror}): install hapticd again.") from None
    files[UNIT] = re.sub(r"^ExecStart=\S+", lambda _: f"ExecStart={program}", files[UNIT], flags=re.MULTILINE)
    return files


def listing(files: Files) -> str:
    """Return all files with their destinations, and the commands to run afterwards."""
    shown = [f"# --- /{DESTINATIONS[name]}\n{text}" for name, text in files.items()]
    return "\n".join([*shown, f"# --- then\n{AFTERWARDS}"])


def install(files: Files, root: Path) -> str:
    """Write the files below `root`; return a report with the next commands. Raises HapticdError."""
    program = next(line.split("=")[1].split()[0] for line in files[UNIT].splitlines() if line.startswith("ExecStart="))
    if program.startswith(tuple(f"{place}/" for place in HIDDEN_BY_UNIT)):
        raise HapticdError(f"{program}: is hidden from the service: install hapticd in /opt, see systemd/README.md.")

    def write(path: Path, name: str) -> str:
        if name in KEPT and path.exists():
            return "kept"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(files[name], encoding="utf-8")
        path.chmod(0o644)
        return "installed"

    return _report(root, write, AFTERWARDS)


def uninstall(root: Path, *, is_print: bool = False) -> str:
    """Remove the files below `root` but the configuration, with `is_print` none; return a report with what to do next.

    Raises HapticdError while the unit is enabled: a service that runs would lose its unit and go on.
    """
    enabled = root / "etc/systemd/system/multi-user.target.wants/hapticd.service"
    if enabled.is_symlink() and not is_print:
        raise HapticdError(f"{enabled}: the service is enabled: run `{FIRST}` before.")

    def remove(path: Path, name: str) -> str:
        if not path.exists() or name in KEPT:
            return "kept" if path.exists() else ""
        if not is_print:
            path.unlink()
        return "removed"

    return _report(root, remove, AFTER_REMOVAL) or f"nothing of hapticd's service is below {root}\n"


def _report(root: Path, change: Callable[[Path, str], str], afterwards: str) -> str:
    """Change each file, and return what was done and the next commands; empty for nothing. Raises HapticdError."""
    done = []
    for name, destination in DESTINATIONS.items():
        path = root / destination
        try:
            done.append((change(path, name), path))
        except OSError as error:
            raise HapticdError(f"{path}: cannot be changed ({error.strerror}): run it as root.") from None
    lines = [f"{what:<10} {path}" for what, path in done if what]
    return "\n".join([*lines, "then run:", *(f"  {line}" for line in afterwards.splitlines()), ""]) if lines else ""


def service_folder() -> Path:
    """Return the folder of the service's files: the package's, else the checkout's."""
    packaged = Path(sysconfig.get_path("data"), "share", "hapticd", "systemd")
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "systemd"
