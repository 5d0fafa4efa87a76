"""One boot for all tests."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import machine


@pytest.fixture(scope="session")
def guest(tmp_path_factory: pytest.TempPathFactory) -> machine.Boot:
    """What the guest's program found: it ran once, to its end."""
    if (reason := machine.missing()) is not None:
        pytest.skip(reason)
    return machine.boot(tmp_path_factory.mktemp("guest"))
