"""The daemon or a client stops, dies or ends; the host's clock leaps."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from faulty_simulation import FaultySimulation
from stand import (
    HANDSHAKE_MS,
    LED_DOWN_MS,
    LINK_MS,
    PERIOD_MS,
    SILENT_MS,
    TIMER_MS,
    agrees,
    doing,
    lines,
    worst,
)

import hapticd

TTL_MS = 500.0
PACKAGE = Path(hapticd.__file__).parent
WALL_CLOCKS = {"time.time", "time.time_ns", "time.localtime", "time.gmtime", "datetime", "time.clock_gettime"}
DATED = (
    "files/recording/header.py",
    "tools/doctor/bundle.py",
    "tools/stream/plotjuggler.py",
    "tools/view/recording.py",
)  # for people, for other programs, for names and the age of files


def test_a_daemon_that_is_stopped_for_two_seconds_leaves_a_quiet_plate_and_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    after = worst(doing(FaultySimulation.stop_daemon, FaultySimulation.resume_daemon), 2.0)
    assert after.quiet_ms <= LINK_MS + SILENT_MS
    assert after.back_ms <= TIMER_MS + HANDSHAKE_MS
    assert after.board["deadman_trips"] == 1
    agrees("daemon stopped for 2 s", after)
    assert [line for line in lines(caplog) if not line.startswith("WARNING trackpad silent")] == []


def test_a_killed_daemon_leaves_a_quiet_plate_and_the_next_one_serves_it() -> None:
    after = worst(doing(FaultySimulation.stop_daemon, FaultySimulation.start_daemon), 0.5)
    assert after.quiet_ms <= LINK_MS + SILENT_MS
    assert after.back_ms <= HANDSHAKE_MS
    agrees("daemon killed, and another started", after)


def test_a_daemon_that_ends_in_mid_stroke_says_zero_first() -> None:
    after = worst(doing(FaultySimulation.end_daemon, FaultySimulation.start_daemon), 0.5)
    assert after.quiet_ms <= LINK_MS + LED_DOWN_MS
    assert after.back_ms <= HANDSHAKE_MS
    agrees("daemon ended in mid-stroke", after)


def test_a_client_that_dies_or_stops_is_released_when_its_time_to_live_ends(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(doing(FaultySimulation.stop_client, FaultySimulation.resume_client), 1.0)
    assert after.quiet_ms <= TTL_MS + max(TIMER_MS, PERIOD_MS) + LINK_MS + LED_DOWN_MS
    assert after.back_ms <= 3 * PERIOD_MS + LINK_MS
    assert after.board["deadman_trips"] == 0
    assert lines(caplog) == []
    agrees("client killed or stopped", after)


def test_an_hour_that_only_the_host_s_clock_saw_is_a_new_beginning(caplog: pytest.LogCaptureFixture) -> None:
    def set_up(stand: FaultySimulation, t_fault_s: float, t_over_s: float) -> None:
        stand.at(t_fault_s, stand.leap_host_clock(3600.0))
        del t_over_s

    after = worst(set_up, 0.1)
    assert after.quiet_ms <= LINK_MS + SILENT_MS
    assert after.back_ms <= 250.0 + HANDSHAKE_MS
    assert "WARNING board: Clock discontinuity (board reset?): reconnecting" in lines(caplog)
    assert not any("silent; requesting" in line for line in lines(caplog))
    agrees("host suspended for an hour", after)


def test_no_part_of_the_daemon_reads_the_wall_clock() -> None:
    for path in {*PACKAGE.rglob("*.py")} - {PACKAGE / name for name in DATED}:
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        named = {ast.unparse(node) for node in nodes if isinstance(node, ast.Attribute)}
        imports = [node for node in nodes if isinstance(node, (ast.Import, ast.ImportFrom))]
        imported = {alias.name for node in imports for alias in node.names}
        assert not (named | imported) & WALL_CLOCKS, path
