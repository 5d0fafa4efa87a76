"""Hints to install something: commands for the Python that runs, which leave hapticd itself as it is."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from hapticd import errors

ROOT = Path(__file__).parents[1]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]


def command_in(error: Exception) -> list[str]:
    (command,) = re.findall(r": run `(.*)`\.$", str(error))
    return shlex.split(command)


def used(top: str) -> set[str]:
    """The extras that errors below a folder name."""
    pattern = r'missing_library\(\s*f?"[^"]*", "(\w+)"\)'
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / top).rglob("*.py")]
    return {extra for text in texts for extra in re.findall(pattern, text)}


@pytest.mark.parametrize("extra", sorted(used("hapticd/")))
def test_a_missing_library_is_installed_by_its_name_into_this_python(extra: str) -> None:
    command = command_in(errors.missing_library("It needs it", extra))
    assert command[:4] == [sys.executable, "-m", "pip", "install"]
    here = [one for one in map(Requirement, EXTRAS[extra]) if one.marker is None or one.marker.evaluate()]
    assert command[4:] == [str(one).partition(";")[0] for one in here] != []
    assert "hapticd" not in " ".join(command[4:])
