"""States from the daemon's socket: all of them, in order, over its restarts, and from real messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from clients.fake_daemon import FakeDaemon
from tools.stream.fake_lsl import FakeLsl

from hapticd.tools.stream import lsl, states
from hapticd_contract.states import PlateState


def test_a_silent_daemon_and_its_return_are_reported_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(states, "POLL_S", 0.02)
    monkeypatch.setattr(states, "SILENT_S", 0.0)
    daemon, received = FakeDaemon(tmp_path), list[PlateState]()
    polls = iter(range(1000))

    def ended() -> bool:
        if next(polls) == 4:  # by then it has been silent for three polls
            daemon.start()
        return bool(received)

    states.serve(received.append, str(tmp_path), ended)
    daemon.stop()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith(f"no state from {tmp_path}: start a daemon")
    assert lines[1] == "the daemon sends states again"


def test_a_plate_with_other_modes_gets_other_outlets(daemon: FakeDaemon) -> None:
    class TimedLsl(FakeLsl):
        local_clock = staticmethod(lambda: 0.0)

    fake: Any = TimedLsl()

    def ended() -> bool:
        pushed = [len(values) for values, _ in fake.pushed.get("hapticd-modes", ())]
        if pushed:
            daemon.modal_um = (0.0, 0.0, 0.0)
        return 12 in pushed

    lsl.run(fake, str(daemon.directory), 1, ended)
    channels = [len(values) for values, _ in fake.pushed["hapticd-modes"]]
    assert channels == sorted(channels)
    assert {*channels} == {8, 12}
