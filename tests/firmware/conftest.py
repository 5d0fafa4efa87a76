"""What the tests of the firmware start from."""

from __future__ import annotations

from pathlib import Path

import pytest

from .bench import Bench
from .built import built


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The board's program as a process of this computer."""
    return built("hapticd-board", tmp_path_factory)
