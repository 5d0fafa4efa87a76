"""Real processes over the simulated rig; shared code is in `service.py`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "clients" / "python"), str(Path(__file__).parent)]

from service import Bench, opened  # noqa: E402


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened() as made:
        yield made
