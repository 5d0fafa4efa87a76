"""Pictures: errors come before the work."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hapticd.errors import HapticdError, UsageError
from hapticd.tools import outputs, plotting


def test_another_suffix_is_refused_before_the_work() -> None:
    outputs.check_suffix(Path("picture.png"), outputs.PICTURE)
    for name in ("picture", "picture.txt", ".png"):
        with pytest.raises(UsageError, match=r"end it in \.png or \.pdf or \.svg"):
            outputs.check_suffix(Path(name), outputs.PICTURE)


def test_without_matplotlib_the_command_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(HapticdError, match=f"run `{sys.executable} -m pip install 'matplotlib>="):
        plotting.subplots(1.0, 1.0)
