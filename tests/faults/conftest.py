"""What goes wrong, and what the plate then does. `python -m pytest tests/faults -n 0 -s` prints the README's table."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "clients" / "python"), str(ROOT / "tests" / "integration"), str(Path(__file__).parent)]

from service import Bench, opened  # noqa: E402


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


@pytest.fixture
def bench() -> Iterator[Bench]:
    """Rig, service and clients as processes."""
    with opened() as made:
        yield made
