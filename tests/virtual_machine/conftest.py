"""One boot for all tests of a file."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
sys.path.insert(0, str(FOLDER))

import machine  # noqa: E402


@pytest.fixture(scope="session")
def guest(tmp_path_factory: pytest.TempPathFactory) -> machine.Boot:
    """What the guest's program found: it ran once, to its end."""
    if (reason := machine.missing()) is not None:
        pytest.skip(reason)
    return machine.boot(FOLDER / "guest" / "program.py", tmp_path_factory.mktemp("guest"))


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> machine.Boot:
    """What the guest found whose first process is systemd."""
    if (reason := machine.missing_systemd()) is not None:
        pytest.skip(reason)
    return machine.boot_systemd(tmp_path_factory.mktemp("service"))
