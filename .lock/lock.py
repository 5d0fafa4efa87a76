"""Writes the versions and hashes that `make` installs, for every supported Python and platform: `make lock` runs it.

All is resolved at once, so that the files agree; each package stands in the first file that needs it, because `make`
installs them in this order.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
PIN = re.compile(r"^([a-z0-9.-]+)==.*(?:\n    .*)*", re.MULTILINE)  # with its hashes


def main() -> None:
    """Write a file for each group of requirements."""
    pyproject = tomllib.loads((FOLDER.parent / "pyproject.toml").read_text(encoding="utf-8"))
    groups = requirements(pyproject)
    oldest = pyproject["project"]["requires-python"].removeprefix(">=")
    left = resolve(sorted({one for group in groups.values() for one in group}), oldest, "--generate-hashes")
    with tempfile.TemporaryDirectory() as scratch:
        versions = Path(scratch, "versions.txt")
        versions.write_text(left, encoding="utf-8")
        for name, group in groups.items():
            needed = {pin[1] for pin in PIN.finditer(resolve(group, oldest, "--constraint", str(versions)))}
            pins = [pin[0] for pin in PIN.finditer(left) if pin[1] in needed]
            (FOLDER / f"{name}.txt").write_text("\n".join(["# by `make lock`", *pins, ""]), encoding="utf-8")
            left = "\n".join(pin[0] for pin in PIN.finditer(left) if pin[1] not in needed)


def requirements(pyproject: dict[str, Any]) -> dict[str, list[str]]:
    """Return what is installed together: to build, for the demo and the viewer, for the tests, for `make lint`, for
    `make docs`."""
    project = pyproject["project"]
    extras = project["optional-dependencies"]
    return {
        "build": pyproject["build-system"]["requires"],
        "demo": [*project["dependencies"], *extras["plot"], *extras["view"]],
        "test": extras["test"],
        "lint": extras["lint"],
        "docs": extras["docs"],
    }


def resolve(group: list[str], oldest: str, *options: str) -> str:
    """Return the newest versions that satisfy a group, in the format of a requirements file."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--no-config", "--universal", "--no-annotate"]
    command += ["--no-header", "--python-version", oldest, *options, "-"]
    return subprocess.run(command, input="\n".join(group), text=True, stdout=subprocess.PIPE, check=True).stdout


if __name__ == "__main__":
    main()
