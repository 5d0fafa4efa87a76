"""Programs of the firmware as processes of this computer."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware"


def built(name: str, factory: pytest.TempPathFactory) -> Path:
    """Build a target of the Makefile in a folder of its own, and return its path; skip where there is no compiler."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    build = factory.mktemp("firmware")
    program = build / name
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), f"BUILD={build}", str(program)], check=True)
    return program
