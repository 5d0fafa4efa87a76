"""Commands to the board and reactions to its messages, in virtual time."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import pairwise

import msgpack
import pytest
from machine_bench import FAULT, LIVE, MS, QUIET, SLIPPERY, STICKY, Bench, lines, references

from hapticd import board_protocol as protocol
from hapticd.core.board.supervisor import State
from hapticd.daemon.machine import STANDBY_EVERY_NS, TIMER_NS
from hapticd.sim.fingers.paths import Line
from hapticd.values import LinkTiming, TouchFrame


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


def test_touching_drives_the_board_and_lifting_leaves_it_a_zero() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    assert all(each.peak_um <= 4.0 for each in references(bench.board.received))
    bench.set_targets({})
    bench.run(60)
    assert bench.board.peak_um == 0.0
    assert bench.state is State.ACTIVE  # fingers whose target ended are held at 0
    bench.pad_speaks = False
    bench.run(60)
    assert bench.state is State.ARMED


def test_a_zero_frame_lost_on_the_line_is_sent_again_before_the_dead_man_notices() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.run(300)
    bench.board.status()
    bench.run(2)
    taken = bench.board.seq
    bench.pad_speaks = False  # its fingers count as lifted
    while not (lost := [each for each in references(bench.run(1)) if each.peak_um == 0.0]):
        pass
    bench.board.seq, bench.board.peak_um = taken, 1.0  # it never received it
    bench.from_board.clear()
    assert bench.machine.timer_period_ns == TIMER_NS
    again = references(bench.run(35))
    assert len(lost) == len(again) == 1
    assert bench.board.peak_um == 0.0
    bench.board.status()
    bench.run(2)
    assert bench.machine.timer_period_ns == 2 * TIMER_NS


def test_a_failed_pass_is_silence_logged_once_and_the_next_good_one_drives(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(Line((-40.0, 5.0), (40.0, 5.0), 60.0), STICKY).driven()
    pipeline = bench.machine.pipeline

    class Broken:
        def __getattr__(self, name: str) -> object:
            return getattr(pipeline, name)

        def drive(self, _t_now_ns: int, _aim: LinkTiming, frames: Sequence[tuple[TouchFrame, int]] = ()) -> None:
            for frame, t_read_ns in frames:
                pipeline.touch(frame, t_read_ns)
            raise ArithmeticError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(bench.machine, "pipeline", Broken())
        bench.run(200)
        assert bench.board.peak_um == 0.0
    assert bench.machine.report_status(bench.t_ns)["touch"]["failed_passes"] > 1
    assert [record.message for record in caplog.records if record.levelname == "ERROR"] == [
        "a pass failed: the plate is quiet until one succeeds"
    ]
    bench.run(60)
    assert bench.board.peak_um > 0.5


def on_standby(bench: Bench) -> Bench:
    """No finger for long enough: the board was left quiet."""
    bench.run(3000)
    assert bench.machine.session.is_on_standby
    assert bench.board.state == QUIET
    return bench


def test_an_idle_board_goes_on_standby_and_gets_no_keep_alives() -> None:
    bench = on_standby(Bench())
    assert bench.machine.timer_period_ns == STANDBY_EVERY_NS
    received = bench.run(5000)
    assert {each.name for each in received} == {"time"}
    assert bench.state is State.ARMED
    assert bench.ask("status")["body"]["board"]["state"] == "QUIET"


def test_a_board_on_standby_is_armed_by_the_first_report_before_any_target() -> None:
    bench = Bench(SLIPPERY, STICKY)
    bench.pad_speaks = False
    on_standby(bench)
    bench.pad_speaks = True
    names: list[str] = []
    while "reference" not in names:
        names = [each.name for each in bench.run(1)]
    assert names.count("reference") == 3  # at once: zero frames, which the board wants before it trusts a host
    assert bench.board.state == LIVE
    assert bench.machine.timer_period_ns == TIMER_NS
    bench.set_targets({1: 1.0, 2: 0.0})
    bench.run(12)
    assert bench.board.peak_um > 0.5


@pytest.mark.parametrize(
    "message",
    [
        {"virtuals": [{"name": "rests", "path_mm": [[0, 0]]}]},
        {"effects": [{"name": "click", "pulse": {"height_um": 1.0, "length_s": 0.05}}]},
    ],
    ids=lambda message: next(iter(message)),
)
def test_a_board_on_standby_is_armed_by_a_message_with_targets(message: dict[str, object]) -> None:
    bench = on_standby(Bench())
    bench.ask("set", client="test", ttl_s=5.0, **message)
    assert not bench.machine.session.is_on_standby
    assert bench.board.state == LIVE
    bench.run(300)
    assert bench.board.state == LIVE


def test_a_board_whose_farewell_the_line_lost_is_kept_alive_and_left_again_later() -> None:
    bench = Bench()
    bench.run(1900)
    bench.board.mute = True
    while "hello" not in [each.name for each in bench.run(1)]:
        pass
    bench.board.state = LIVE  # it never received it
    bench.board.mute = False
    bench.board.status()
    assert "keep-alive" in [each.name for each in bench.run(60)]
    assert not bench.machine.session.is_on_standby
    on_standby(bench)


def test_a_latched_fault_silences_the_plate_until_a_client_clears_it(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    lines(caplog)
    bench.board.latch(3)
    bench.run(300)
    assert bench.state is State.FAULT
    assert bench.board.peak_um == 0.0
    bench.set_targets({1: 2.0, 2: 0.0})
    assert not any(each.peak_um for each in references(bench.run(300)))
    assert bench.ask("clear_fault")["ok"]
    bench.run(100)
    assert bench.state is State.ACTIVE
    assert bench.board.peak_um > 0.5
    fault, left = lines(caplog)
    assert fault.startswith("board fault: the measured amplitude stayed far above its limit. Output disabled")
    assert left == "board fault cleared: a client cleared it"


def test_a_fault_outlives_the_board_that_had_it_and_can_still_be_cleared() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.board.latch(3)
    bench.run(50)
    bench.board.plugged = False
    bench.machine.board_link(False, "pulled", bench.t_ns)
    bench.run(100)
    refused = bench.ask("clear_fault")
    assert refused["error"].startswith("The board does not answer, so its fault cannot be cleared")
    bench.board.plugged, bench.board.state, bench.board.fault_code, bench.board.boot_id = True, QUIET, 0, 99
    bench.machine.board_link(True, "back", bench.t_ns)
    bench.run(500)
    assert bench.state is State.FAULT  # not cleared
    assert bench.ask("clear_fault")["ok"]
    bench.run(200)
    assert bench.state is State.ACTIVE


def test_a_fault_with_its_cause_stays_and_an_old_request_clears_no_later_one() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.board.latch(6)
    bench.run(50)
    bench.machine.request(msgpack.packb({"v": 1, "id": 1, "op": "clear_fault"}), bench.t_ns)
    bench.board.state, bench.board.fault_code = FAULT, 6
    bench.from_board.clear()
    bench.run(1000)
    assert bench.state is State.FAULT
    bench.board.state, bench.board.fault_code = QUIET, 0
    bench.run(300)
    assert bench.state is State.FAULT


def test_a_board_is_left_with_a_greeting_and_one_that_never_answered_with_nothing() -> None:
    bench = Bench(SLIPPERY, STICKY)
    assert not bench.machine.disconnect(bench.t_ns)
    bench.driven()
    bench.machine.stop(bench.t_ns)
    assert bench.machine.disconnect(bench.t_ns)
    zero, leave = bench.board.received[-2:]
    assert (zero.name, zero.peak_um, leave.name) == ("reference", 0.0, "hello")


def test_what_the_board_refuses_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(SLIPPERY).driven()
    caplog.clear()
    for request, verdict in ((protocol.MSG_SET_CONTROLLER, 0), (protocol.MSG_SET_MODEL, 1)):
        bench.board.say(protocol.MSG_VERDICT, protocol.VERDICT.pack(request, verdict))
    bench.run(50)
    assert [line for line in lines(caplog) if "refused" in line] == [
        "board refused: The board refuses the calibration of a mode: a value is out of range."
    ]


def test_while_reports_come_no_timer_is_needed() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.timer_runs = False
    received = bench.run(2000)
    assert [each.name for each in received].count("time") >= 3
    lives = [each.t_ns for each in received if each.name in ("reference", "keep-alive")]
    assert max(after - before for before, after in pairwise(lives)) <= 34 * MS  # of the 50 that the board waits
    bench.set_targets({1: 1.0}, ttl_s=0.1)
    bench.run(100 + 23)
    assert bench.machine.scene.next_expiry_ns is None
