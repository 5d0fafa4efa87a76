"""The real-time soak in short: its counters are there; no test depends on a time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from machine_bench import PLATE

from hapticd.bench import soak_real_time
from hapticd.bench.soak_load import longest_stall_ms
from hapticd.bench.soak_real_time import Watch
from hapticd.bench.stall_monitor import SLEEP_S
from hapticd.config.sections import Config
from hapticd.core.trajectory.gate import gate
from hapticd.daemon.machine import Machine
from hapticd.errors import HapticdError
from hapticd.values import Drive, Knot
from hapticd.wire import device

pytestmark = pytest.mark.long

STALL_S = 0.3  # far longer than the stalls of a busy machine


def test_hogs_and_floods_break_no_limit_and_frames_go_on() -> None:
    policy = os.sched_getscheduler(0)
    (table,) = soak_real_time.run(0.6)
    assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == policy & ~os.SCHED_RESET_ON_FORK
    assert [row.name for row in table.rows] == ["no load", "hogs on every processor", "4 clients flood"]
    for row in table.rows:
        assert row.figures["frames_count"] > 0
        assert 0.0 < row.figures["peak_um"] <= 4.0
        assert {"dead_man_trips_count", "gc_pauses_count", "missed_ticks_count", "late_frames_count"} <= {*row.figures}
        assert {"machine_stall_ms"} <= {*row.figures}
        assert row.figures["longest_silence_ms"] > 0.0
    flooded = table.row("4 clients flood").figures
    assert flooded["offered_hz"] >= flooded["sent_hz"] > 0.0


def test_every_write_is_decoded_as_by_the_board_and_each_load_starts_at_zero() -> None:
    watch = Watch(Machine(Config(), PLATE, write_board=lambda _: True))
    drive = gate(Drive(0, (Knot(0, (1.0, -0.5)), Knot(8_000_000, (0.25 + 2.0j, -3.5)))), (4.0, 4.0))
    frame = device.encode_reference(1, drive, 1000)
    watch.observer("written", 0, frame[:9], True)
    watch.observer("status", 0, frame)
    watch.observer("written", 0, frame[9:], True)
    assert (watch.references.frames, watch.references.peak_um) == (1, pytest.approx(3.5, rel=1e-6))
    before = watch.machine.status.loop
    watch.restart()
    assert (watch.references.frames, watch.references.peak_um) == (0, 0.0)
    assert watch.machine.status.loop is not before


def test_a_silence_ends_with_the_next_write_that_the_port_accepts() -> None:
    watch = Watch(Machine(Config(), PLATE, write_board=lambda _: True))
    for t_ns, is_accepted in ((0, True), (50, True), (55, False), (101, True)):
        watch.observer("written", t_ns, b"\0", is_accepted)
    assert watch.longest_silence_ns == 51
    watch.restart()
    assert watch.longest_silence_ns == 0


def test_a_stall_monitor_reports_its_longest_stall_once() -> None:
    command = [sys.executable, "-m", "hapticd.bench.stall_monitor", "0", "0"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as monitor:
        assert monitor.stdout.readline() == "ready\n"
        monitor.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, monitor.pid, os.WSTOPPED)
        t_from_s = time.monotonic()
        while time.monotonic() - t_from_s < STALL_S:
            pass
        monitor.send_signal(signal.SIGCONT)
        first_ms, second_ms = longest_stall_ms([monitor]), longest_stall_ms([monitor])
        monitor.stdin.close()
        assert monitor.wait(60.0) == 0
    assert first_ms >= (STALL_S - SLEEP_S) * 1e3
    assert second_ms < first_ms


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), 1e9])
def test_a_time_out_of_bounds_is_one_sentence(seconds: float) -> None:
    with pytest.raises(HapticdError, match=r"--real-time: .* is out of bounds, it must be above 0 and at most 3600"):
        soak_real_time.run(seconds)


def test_a_flooder_ends_with_its_input_and_prints_how_much_it_offered() -> None:
    command = [sys.executable, "-m", "hapticd.bench.flood", "inproc://unbound", "test"]
    done = subprocess.run(command, input="", capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 0
    ready, counts = done.stdout.splitlines()
    assert ready == "ready"
    offered, sent = map(int, counts.split())
    assert (offered, sent) == (0, 0)
