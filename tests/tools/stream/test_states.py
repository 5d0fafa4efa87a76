"""States from the daemon's socket: all of them, in order, over its restarts, and from real messages."""

from __future__ import annotations

from typing import Any

import pytest
from tools.stream.daemon_states import FakeDaemon, state_fields
from tools.stream.fake_lsl import FakeLsl

from hapticd.tools.stream import lsl, states
from hapticd_contract.states import PlateState


def test_a_silent_daemon_and_its_return_are_reported_once(
    fake_daemon: FakeDaemon, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(states, "POLL_S", 0.02)
    monkeypatch.setattr(states, "SILENT_S", 0.0)
    received: list[PlateState] = []
    polls = iter(range(1000))

    def ended() -> bool:
        if next(polls) == 4:  # by then it has been silent for three polls
            fake_daemon.wait_for_subscriber()
            fake_daemon.publish(state_fields(1))
        return bool(received)

    states.serve(received.append, str(fake_daemon.directory), ended)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith(f"no state from {fake_daemon.directory}: start a daemon")
    assert lines[1] == "the daemon sends states again"


def test_a_plate_with_other_modes_gets_other_outlets(fake_daemon: FakeDaemon) -> None:
    class TimedLsl(FakeLsl):
        local_clock = staticmethod(lambda: 0.0)

    fake: Any = TimedLsl()
    messages = enumerate(([0.0, 0.0], [0.0, 0.0], [0.0, 0.0, 0.0]))

    def ended() -> bool:
        for place, modal_um in messages:
            if place == 0:
                fake_daemon.wait_for_subscriber()
            fake_daemon.publish(state_fields(place, modal_um=modal_um))
        return len(fake.pushed.get("hapticd-modes", ())) == 3

    lsl.run(fake, str(fake_daemon.directory), 1, ended)
    assert [len(values) for values, _ in fake.pushed["hapticd-modes"]] == [8, 8, 12]
