"""Wrong calls of commands, the figures that commands draw, frames with known delays, a daemon's status, and a daemon
without a plate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from clients.conftest import daemon  # noqa: F401
from machine_bench import SLIPPERY, STICKY, Bench

from hapticd.__main__ import main
from hapticd.tools import plotting
from hapticd.tools.latency import MeasuredLatency, gather


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


@pytest.fixture(scope="session")
def measured() -> MeasuredLatency:
    """Frames of a driven bench whose board acknowledges each millisecond; the link takes no time, reports come every
    11.25 ms."""
    bench = Bench(SLIPPERY, STICKY).driven()
    for _ in range(1000):
        bench.machine.pipeline.invalidate_reference()
        bench.run(1)
        bench.board.status()
    return gather(bench.machine, list(bench.machine.session.ledger.lines))


@pytest.fixture(scope="session")
def reported() -> dict[str, Any]:
    """The status of a machine that drives two fingers."""
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.board.status()
    bench.run(300)
    return dict(bench.machine.report_status(bench.t_ns))
