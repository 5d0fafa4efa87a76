"""The host's clock leaps, and no part of the daemon reads the wall clock."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from faulty_simulation import FaultySimulation
from stand import HANDSHAKE_MS, LINK_MS, SILENT_MS, agrees, lines, worst

import hapticd

PACKAGE = Path(hapticd.__file__).parent
WALL_CLOCKS = {"time.time", "time.time_ns", "time.localtime", "time.gmtime", "datetime", "time.clock_gettime"}
DATED = (
    "files/recording/header.py",
    "tools/doctor/bundle.py",
    "tools/stream/plotjuggler.py",
    "tools/view/recording.py",
)  # for people, for other programs, for names and the age of files


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
