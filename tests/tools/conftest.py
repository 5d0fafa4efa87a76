"""Wrong calls of commands, the figures that commands draw, and a fake of the daemon's sockets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tools.stream.daemon_states import FakeDaemon

from hapticd.__main__ import main
from hapticd.files import plotting


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a wrong call, which prints one line and nothing else; returns that line."""

    def run(*arguments: str) -> str:
        assert main(arguments) == 2
        printed = capsys.readouterr()
        assert (printed.out, printed.err.count("\n")) == ("", 1)
        return printed.err

    return run


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every figure that is drawn; no file is written of it."""
    drawn: list[Any] = []
    monkeypatch.setattr(plotting, "save", lambda figure, *_, **__: drawn.append(figure))
    return drawn


@pytest.fixture
def fake_daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    daemon = FakeDaemon(tmp_path)
    yield daemon
    daemon.close()
