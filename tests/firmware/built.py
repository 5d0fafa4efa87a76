"""Programs of the firmware as processes of this computer."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware"
_BUILT: dict[str, Path] = {}  # a compilation takes five seconds


def built(name: str, factory: pytest.TempPathFactory) -> Path:
    """Return a target of the Makefile, built once in a folder of its own; skip where there is no compiler."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    if name in _BUILT:
        return _BUILT[name]
    build = factory.mktemp("firmware")
    program = _BUILT[name] = build / name
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), f"BUILD={build}", str(program)], check=True)
    return program
