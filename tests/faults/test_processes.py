"""Faults that only real processes have: signals, and a reader of standard error that stalls."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest
from service import Bench, drive, is_driven, is_quiet, wait_board, wait_for, wait_state
from stand import DRIVEN_UM, QUIET_UM, SILENT_MS, tell

from hapticd.board_protocol import BoardState
from hapticd_client import Client

pytestmark = pytest.mark.long
TTL_S = 0.5
BUSY_S = 0.5  # for a machine that has other things to do
DAEMON_S = 2.0


def stay_driven(client: Client) -> None:
    """Until the plate has ramped in and moved for some twenty reports."""
    for _ in zip(range(20), client.states(), strict=False):
        pass


def test_a_daemon_stopped_for_two_seconds_leaves_the_plate_quiet_and_drives_it_again(bench: Bench) -> None:
    rig, service, client, _ = bench.driven(record=True)
    stay_driven(client)
    service.process.send_signal(signal.SIGSTOP)
    t_stop_s = time.monotonic() - rig.t_start_s
    wait_board(bench.rig_dir, BoardState.QUIET, round(10 * DAEMON_S))  # ten statuses a second
    t_cont_s = time.monotonic() - rig.t_start_s
    service.process.send_signal(signal.SIGCONT)
    wait_for(lambda: client.status()["board"].get("deadman_trips") == 1)  # what was known before is known no more
    drive(client)  # of the time while it was stopped it knows nothing: fingers may be new ones
    stay_driven(client)
    warnings = service.lines_with("WARNING")
    arrays = rig.recording()
    t_s, level_um = arrays["t_s"].real, np.abs(arrays["modal_um"]).max(axis=1)
    stopped = (t_s > t_stop_s) & (t_s < t_cont_s)
    assert level_um[(t_s > t_stop_s - 0.3) & (t_s < t_stop_s)].max() > DRIVEN_UM
    assert level_um[t_s > t_cont_s].max() > DRIVEN_UM
    moving_ms = (t_s[stopped & (level_um > QUIET_UM)][-1] - t_stop_s) * 1e3
    expected = ("silent", "timing since the start", "this process did not run")
    assert [line for line in warnings if not any(words in line for words in expected)] == []
    assert moving_ms <= SILENT_MS + BUSY_S * 1e3
    assert service.lines_with("ERROR") == []
    tell("daemon stopped for 2 s, as processes", None, f"the plate moved for {moving_ms:.0f} ms", *warnings)


def test_a_stopped_client_s_fingers_are_released_within_its_time_to_live(bench: Bench) -> None:
    watcher, stopped = bench.driven_by_a_program(TTL_S)
    stopped.send_signal(signal.SIGSTOP)
    t_stop_ns = time.monotonic_ns()
    released = wait_state(watcher, is_quiet)
    assert released.t_ns - t_stop_ns <= (TTL_S + BUSY_S) * 1e9
    stopped.send_signal(signal.SIGCONT)
    wait_state(watcher, is_driven)  # it asks again by itself
    tell("client stopped, as processes", None, f"its targets, after {(released.t_ns - t_stop_ns) * 1e-6:.0f} ms", "")


def test_a_terminal_that_stalls_stalls_nobody_else(bench: Bench) -> None:
    bench.rig()
    reader, writer = os.pipe()
    try:
        os.set_blocking(writer, False)
        filled = 0
        while filled < 1 << 20:
            try:
                filled += os.write(writer, bytes(4096))
            except BlockingIOError:
                break
        os.set_blocking(writer, True)
        service = bench.service(stderr=writer)  # its very first line would block for ever
        drive(bench.client())
        assert service.end(signal.SIGTERM) == 0
    finally:
        os.close(reader)
        os.close(writer)
    tell("the reader of standard error stalls", None, "log lines: the next that passes says how many", "")
