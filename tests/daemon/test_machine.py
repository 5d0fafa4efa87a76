"""The daemon without sockets, in virtual time: genuine reports and requests in, commands to the board out."""

from __future__ import annotations

import gc
import logging
import weakref

import pytest
from machine_bench import SLIPPERY, STICKY, Bench

from hapticd.core.board.supervisor import State
from hapticd.values import RawReport


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


def test_a_machine_that_another_replaces_is_gone_at_once() -> None:
    """The daemon's collector never looks at what was there when it became ready."""
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.ask("status")
    machine = weakref.ref(bench.machine)
    gc.disable()
    try:
        del bench.machine
        assert machine() is None
    finally:
        gc.enable()


# --- the clients' side ------------------------------------------------------------------------------------------


def test_the_last_thing_said_is_silence() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.machine.stop(bench.t_ns)
    assert bench.board.received[-1].name == "reference"
    assert bench.board.received[-1].peak_um == 0.0
    said = len(bench.board.received)
    bench.machine.reports([RawReport(bench.t_ns, b"\x02")], bench.t_ns)
    bench.set_targets({1: 4.0, 2: 0.0})
    bench.machine.trackpad_link(True, "late", bench.t_ns)
    assert bench.board.received[said:] == []
    assert bench.state is State.STOPPED


def test_a_listener_changes_no_byte_to_the_board_and_each_pass_is_published() -> None:
    alone, watched = Bench(SLIPPERY, STICKY).driven(), Bench(SLIPPERY, STICKY).driven()
    states: list[bytes] = []
    watched.machine.status.publish = states.append
    received = [bench.run(300) for bench in (alone, watched)]
    assert received[0] == received[1]
    assert len(states) > 20
    assert [bench.ask("status")["body"]["telemetry"]["published"] for bench in (alone, watched)] == [0, len(states)]


def test_bad_messages_are_counted_and_the_last_refusal_is_kept() -> None:
    bench = Bench()
    bench.machine.targets(b"\xc1", bench.t_ns)
    bench.send(ttl_s=99.0, targets=[])
    clients = bench.ask("status")["body"]["clients"]
    assert clients["refused"] == 2
    assert "ttl_s" in clients["last_refusal"]
