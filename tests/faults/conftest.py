"""What goes wrong, and what the plate then does. `python -m pytest tests/faults -n 0 -s` prints the README's table."""

from __future__ import annotations

import logging
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "clients" / "python"), str(ROOT / "tests" / "integration"), str(Path(__file__).parent)]

from service import Bench  # noqa: E402


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


@pytest.fixture
def bench() -> Iterator[Bench]:
    """Rig, service and clients as processes, in a folder with a short name: a socket allows 107 bytes."""
    with tempfile.TemporaryDirectory(prefix="hd-") as folder:
        made = Bench(Path(folder))
        try:
            yield made
        finally:
            made.close()
