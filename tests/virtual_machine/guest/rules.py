"""udevd with the project's rules, in a guest that has neither: what they make of a node, and a user they are for."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from kernel import wait_for

ROOT = Path(__file__).parents[3]
RULES = ROOT / "systemd/71-hapticd.rules"
GROUP, GID = "hapticd-dev", 64444  # in the guest alone; udev knows groups by their names
UID = 64445
# In the group, and else without rights: but it may enter every folder, for an interpreter can lie in somebody's home.
AS_USER = (
    "setpriv", f"--reuid={UID}", f"--regid={UID}", f"--groups={GID}",
    "--inh-caps=-all,+dac_read_search", "--ambient-caps=-all,+dac_read_search", "--bounding-set=-all,+dac_read_search",
)  # fmt: skip
UDEVD = Path("/lib/systemd/systemd-udevd")


def start() -> None:
    """From now on every new node gets what the distribution's rules and ours say."""
    groups = Path("/etc/group").read_text(encoding="utf-8").splitlines()
    kept = [line for line in groups if not line.startswith(f"{GROUP}:")]
    Path("/run/group").write_text("\n".join([*kept, f"{GROUP}:x:{GID}:", ""]), encoding="utf-8")
    subprocess.run(["mount", "--bind", "/run/group", "/etc/group"], check=True)
    folder = Path("/run/udev/rules.d")
    folder.mkdir(parents=True)
    (folder / RULES.name).write_text(RULES.read_text(encoding="utf-8"), encoding="utf-8")
    subprocess.run([UDEVD, "--daemon"], check=True)


def record(node: Path) -> Path:
    """Where udevd keeps what it knows of a node: written when it has finished with it, removed when it is gone."""
    number = node.stat().st_rdev
    return Path(f"/run/udev/data/c{os.major(number)}:{os.minor(number)}")


def outcome(node: Path) -> dict[str, str]:
    """Access and tags of a node, once udevd has finished with it."""
    wait_for(f"udev's word on {node}", record(node).exists)
    status, properties = node.stat(), _properties(node)
    return {
        "mode": f"{status.st_mode & 0o777:04o}",
        "group": "ours" if status.st_gid == GID else str(status.st_gid),
        "tags": properties.get("CURRENT_TAGS", ""),
        "modem_manager": "ignores it" if properties.get("ID_MM_DEVICE_IGNORE") == "1" else "greets it",
    }


def _properties(node: Path) -> dict[str, str]:
    command = ["udevadm", "info", "--query=property", f"--name={node}"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return dict(line.split("=", 1) for line in printed.splitlines())
