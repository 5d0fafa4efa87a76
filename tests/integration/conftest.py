"""Real processes over the simulated rig; shared code is in `service.py`."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "clients" / "python"), str(Path(__file__).parent)]

from service import Bench  # noqa: E402


@pytest.fixture
def bench() -> Iterator[Bench]:
    """A folder with a short name, for a socket allows 107 bytes, and an end to all that runs in it."""
    with tempfile.TemporaryDirectory(prefix="hd-") as folder:
        made = Bench(Path(folder))
        try:
            yield made
        finally:
            made.close()
