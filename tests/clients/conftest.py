"""Puts the client library, which is no part of the daemon, on the path for these tests."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "clients" / "python"), str(Path(__file__).parent)]

from fake_daemon import FakeDaemon  # noqa: E402

from hapticd_client import Client  # noqa: E402


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    """A daemon that serves `tmp_path` with an empty plate."""
    running = FakeDaemon(tmp_path)
    running.start()
    yield running
    running.stop()


@pytest.fixture
def client(daemon: FakeDaemon) -> Iterator[Client]:
    with Client(daemon.directory) as client:
        yield client
