"""What the tests of the firmware start from."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from .bench import Bench

FIRMWARE = Path(__file__).parents[2] / "firmware"


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The board's program as a process of this computer."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    build = tmp_path_factory.mktemp("firmware")
    built = build / "hapticd-board"
    subprocess.run(["make", "-s", "-C", str(FIRMWARE), f"BUILD={build}", str(built)], check=True)
    return built
