"""A fake of the daemon's sockets."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tools.stream.daemon_states import FakeDaemon


@pytest.fixture
def fake_daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    daemon = FakeDaemon(tmp_path)
    yield daemon
    daemon.close()
