"""The daemon without sockets, in virtual time: genuine reports and requests go in, and what the board hears is read."""

from __future__ import annotations

import gc
import logging
import weakref

import pytest
from machine_bench import MS, SLIPPERY, START_NS, STICKY, Bench, lines, references

from hapticd.core.board.supervisor import State
from hapticd.files.recording.kinds import Record, record_of
from hapticd.values import RawReport


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


def test_a_pad_that_falls_silent_with_fingers_down_is_one_zero_frame(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    lines(caplog)
    bench.pad_speaks = False
    said = references(bench.run(1000))
    assert [each.peak_um for each in said][-1:] == [0.0]
    assert len([each for each in said if each.peak_um == 0.0]) == 1
    assert said[-1].t_ns <= START_NS + 460 * MS + 12 * MS + 50 * MS  # silence_ms after the last report, and the timer
    assert lines(caplog) == ["trackpad silent with 2 fingers down: they count as lifted"]
    assert bench.machine.pipeline.fingers == ()


def test_a_pulled_pad_is_one_line_and_a_zero_frame_at_once(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    lines(caplog)
    bench.pad_speaks = False
    bench.machine.trackpad_link(False, "the pad was pulled", bench.t_ns)
    assert bench.board.peak_um == 0.0
    assert bench.state is State.IDLE
    bench.run(300)
    assert lines(caplog) == ["trackpad: the pad was pulled"]
    bench.machine.trackpad_link(True, "the pad is back", bench.t_ns)
    bench.pad_speaks = True
    bench.run(50)
    bench.want({3: 1.0, 4: 0.0})  # fingers on a new pad are new fingers
    bench.run(60)
    assert bench.state is State.ACTIVE
    assert bench.board.peak_um > 0.5


def test_a_pad_of_another_model_gets_its_own_decoder() -> None:
    bench = Bench()
    bench.machine.trackpad_link(True, "another", bench.t_ns, model="mt1")
    assert bench.machine.trackpad.model == "mt1"
    assert bench.ask("status")["body"]["trackpad"]["model"] == "mt1"


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


def test_what_runs_out_is_released_and_its_fingers_held_at_zero() -> None:
    bench = Bench(SLIPPERY, STICKY)
    bench.run(400)
    bench.want({1: 1.0, 2: 0.0}, ttl_s=0.3)
    bench.run(290)
    assert bench.board.peak_um > 0.5
    bench.run(25)
    assert bench.board.peak_um == 0.0
    assert [point.target_um for point in bench.machine.last_tick.points] == [0.0, 0.0]  # type: ignore[union-attr]


def test_virtual_fingers_walk_on_without_a_single_report() -> None:
    bench = Bench()
    bench.run(400)
    path = {"name": "walker", "path_mm": [[-40.0, 0.0], [40.0, 0.0]], "speed_mm_s": 50.0}
    bench.send(targets=[{"finger": "walker", "amplitude_um": 1.0}], virtuals=[path])
    assert bench.machine.clients.last_refusal == ""
    said = references(bench.run(400))
    assert bench.state is State.ACTIVE
    assert len(said) >= 38  # a pass each timer


def test_the_last_thing_said_is_silence() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    bench.machine.stop(bench.t_ns)
    assert bench.board.heard[-1].name == "reference"
    assert bench.board.heard[-1].peak_um == 0.0
    said = len(bench.board.heard)
    bench.machine.reports([RawReport(bench.t_ns, b"\x02")], bench.t_ns)
    bench.want({1: 4.0, 2: 0.0})
    bench.machine.trackpad_link(True, "late", bench.t_ns)
    assert bench.board.heard[said:] == []
    assert bench.state is State.STOPPED


def test_telemetry_is_built_for_listeners_only() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    assert bench.machine.status.published == 0
    states = bench.published()
    bench.run(100)
    assert 8 <= len(states) <= 10
    assert [state["seq"] for state in states] == list(range(1, len(states) + 1))
    last = states[-1]
    assert (last["state"], last["instance"]) == ("ACTIVE", 4)
    assert [(finger["id"], finger["target_um"]) for finger in last["fingers"]] == [(1, 1.0), (2, 0.0)]
    assert last["fingers"][0]["x_mm"] == pytest.approx(-30.2, abs=0.1)
    assert last["fingers"][1]["achieved_um"] == pytest.approx(0.0, abs=1e-9)
    bench.machine.status.publish = None
    bench.run(100)
    assert bench.machine.status.published == len(states)


def test_a_listener_changes_nothing_of_what_the_board_hears_and_the_unbuilt_are_counted() -> None:
    alone, watched = Bench(SLIPPERY, STICKY).driven(), Bench(SLIPPERY, STICKY).driven()
    states: list[bytes] = []
    watched.machine.status.publish = states.append
    heard = [bench.run(300) for bench in (alone, watched)]
    assert heard[0] == heard[1]
    assert alone.machine.status.skipped_no_subscriber - watched.machine.status.skipped_no_subscriber == len(states) > 20
    said = alone.ask("status")["body"]["telemetry"]
    assert said == {"published": 0, "skipped_no_subscriber": alone.machine.status.skipped_no_subscriber}


def test_bad_messages_are_counted_and_the_last_refusal_is_kept() -> None:
    bench = Bench()
    bench.machine.targets(b"\xc1", bench.t_ns)
    bench.send(ttl_s=99.0, targets=[])
    clients = bench.ask("status")["body"]["clients"]
    assert clients["refused"] == 2
    assert "ttl_s" in clients["last_refusal"]


def test_requests_are_answered_with_a_body_or_a_sentence() -> None:
    bench = Bench(SLIPPERY, STICKY)
    bench.run(400)
    assert bench.ask("hello")["body"]["instance"] == 4
    body = {"client": "test", "ttl_s": 1.0, "targets": [{"finger": 1, "amplitude_um": 99.0}], "virtuals": []}
    assert "99" in bench.ask("set", **body)["error"]
    body["targets"] = [{"finger": 1, "amplitude_um": 1.0}]
    assert bench.ask("set", **body)["ok"]
    assert bench.ask("release", client="test", finger=1)["body"] == {"released": True}
    assert bench.ask("release", client="test", finger=1)["body"] == {"released": False}
    assert bench.ask("release", client="test")["body"] == {"released": True}
    assert not bench.ask("dance")["ok"]


def test_readings_of_another_number_of_sensors_are_refused() -> None:
    bench = Bench(SLIPPERY)
    with pytest.raises(ValueError, match="2 modes need 4"):
        bench.machine.adopt_readings([1.0], [0.0], START_NS)


def test_a_load_is_refused_where_no_parasitic_modes_are_known() -> None:
    with pytest.raises(ValueError, match="no parasitic modes are known"):
        Bench(SLIPPERY).machine.adopt_load(100.0, 0.0, START_NS)


def test_a_pass_is_recorded_also_where_nobody_asks_what_fingers_perceive() -> None:
    records: list[Record] = []
    bench = Bench(SLIPPERY, STICKY)
    bench.machine.observer_perceives = False
    bench.machine.observer = lambda kind, t_ns, *values: records.append(record_of(kind, 0, t_ns, values))
    bench.driven()
    points = [point for record in records if record.kind == "pass" for point in record.fields["points"]]
    assert points
    assert not any("weber_frac" in point for point in points)
