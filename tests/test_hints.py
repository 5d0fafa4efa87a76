"""Hints to install something are commands that work in a checkout: nothing of hapticd is on a package index."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hapticd.errors import missing_client, missing_library

ROOT = Path(__file__).parents[1]
PLACES = {".": ROOT, "clients/python": ROOT / "clients" / "python"}
ON_AN_INDEX = {"hidapi"}
CALL = re.compile(r'pip install((?: (?:\\?"[^"\\]+\\?"|[-\w./]+))+)')


def texts() -> Iterator[tuple[str, str]]:
    for top in ("README.md", "hapticd", "clients", "firmware", "systemd"):
        for path in [ROOT / top, *(ROOT / top).rglob("*")]:
            if path.suffix in (".md", ".py", ".js", ".html"):
                yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def hints() -> list[tuple[str, str]]:
    """Each printed `pip install`, with the file that prints it; those made by `missing_library` are below."""
    found = [(name, call.strip()) for name, text in texts() for call in CALL.findall(text)]
    return [(name, call) for name, call in found if "{extra}" not in call]


def project(place: str) -> dict[str, Any]:
    return dict(tomllib.loads((PLACES[place] / "pyproject.toml").read_text(encoding="utf-8"))["project"])


def check_hint(call: str) -> None:
    requirements = [word for word in shlex.split(call.replace("\\", "")) if not word.startswith("-")]
    assert requirements
    for requirement in requirements:
        place, _, extras = requirement.rstrip("]").partition("[")
        assert place in PLACES or place in ON_AN_INDEX, requirement
        for extra in extras.split(",") if extras else ():
            assert extra in project(place)["optional-dependencies"], requirement


def test_there_are_hints_to_look_at() -> None:
    assert len(hints()) >= 10


@pytest.mark.parametrize(("where", "call"), hints())
def test_a_printed_hint_installs_what_exists(where: str, call: str) -> None:
    assert where
    check_hint(call)


def test_every_error_about_a_missing_library_names_an_extra() -> None:
    calls = [call for _, text in texts() for call in re.findall(r'missing_library\(\s*f?"[^"]*", "(\w+)"\)', text)]
    assert len(calls) >= 8
    for extra in calls:
        (command,) = re.findall(r"`pip install (.*)`", str(missing_library("It needs it", extra)))
        check_hint(command)
    assert "`pip install clients/python`" in str(missing_client("The demo"))
