"""What `make` installs: one version of each package, with hashes, for each Python and processor."""

from __future__ import annotations

import re
import runpy
import tomllib
from itertools import product
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / ".lock"
GROUPS: dict[str, list[str]] = runpy.run_path(str(FOLDER / "lock.py"))["requirements"](
    tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
)
ORDER = list(GROUPS)  # of installation
TEXTS = {name: (FOLDER / f"{name}.txt").read_text(encoding="utf-8") for name in ORDER}
BLOCKS = [block for text in TEXTS.values() for block in re.findall(r"(?m)^[^#\s].*(?:\n    .*)*", text)]
MACHINES = [
    {"sys_platform": "linux", "platform_system": "Linux", "os_name": "posix", "platform_machine": machine,
     "python_version": version, "python_full_version": f"{version}.4"}
    for version, machine in product(("3.11", "3.12", "3.13", "3.14"), ("x86_64", "aarch64"))
]  # fmt: skip


def names(environment: dict[str, str]) -> str:
    return f"{environment['python_version']}-{environment['platform_machine']}"


def pinned(text: str, environment: dict[str, str]) -> list[tuple[str, str]]:
    """The packages of a file with their versions, on one machine."""
    lines = [Requirement(line.rstrip(" \\")) for line in re.findall(r"(?m)^[^#\s].*", text)]
    held = [one for one in lines if one.marker is None or one.marker.evaluate(environment)]
    return [(one.name, str(one.specifier).removeprefix("==")) for one in held]


@pytest.mark.parametrize("environment", MACHINES, ids=names)
def test_each_requirement_is_met_by_the_files_up_to_that_of_its_group(environment: dict[str, str]) -> None:
    installed: dict[str, str] = {}
    for name in ORDER:
        for package, version in pinned(TEXTS[name], environment):
            assert package not in installed, f"{package} is pinned twice"
            installed[package] = version
        for one in map(Requirement, GROUPS[name]):
            if one.marker is None or one.marker.evaluate(environment):
                assert one.specifier.contains(installed[canonicalize_name(one.name)]), f"`make lock` for {one}"


def test_each_package_has_hashes_and_none_has_an_address() -> None:
    assert len(BLOCKS) > 50
    for block in BLOCKS:
        assert re.fullmatch(r"[a-z0-9.-]+==[\w.]+(?: ; [^\\\n]*)?(?: \\\n    --hash=sha256:[0-9a-f]{64})+", block), (
            block
        )
