"""`hapticd status`: one page of what the daemon reports, its JSON, and its exit code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from hapticd.__main__ import main
from hapticd.tools.doctor import service
from hapticd.tools.doctor.finding import System

REPORTED: dict[str, Any] = {
    "state": "ACTIVE",
    "state_changes": [{"to": "ACTIVE", "ago_ms": 12.5, "why": "a finger\x1b[2J"}],
    "fingers": 0,
    "assets": {},
    "touch": {"frames": 12, "left_out_knots": 0, "anything_new": 3},
    "board": {"ready": True, "round_trip_ms": 1.5, "dropped": {"crc": 0}},
    "surfaces": [{"client": "me", "name": f"s{n}", "z": n} for n in range(6)],
    "timing": {"missed_ticks": 0, "histograms": {"age": {"count": 1}}},
}


def run(monkeypatch: pytest.MonkeyPatch, reported: Mapping[str, Any] | None, *arguments: str) -> int:
    monkeypatch.setattr(service, "find", lambda config, *_: System(config, Path("/run/here"), reported, "0.1.0"))
    return main(["status", *arguments])


def test_the_page_has_what_is_neither_zero_nor_empty(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, REPORTED) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    assert "/run/here" in first
    names = [line[:16].rstrip() for line in lines if line[0] != " "]
    assert names == ["state", "state changes", "fingers", "touch", "board", "surfaces"]
    page = "\n".join(lines)
    assert "frames 12, anything new 3" in page
    assert "ready yes, round trip 1.5 ms" in page
    assert "2 more" in page
    assert "\x1b" not in page


def test_failed_passes_are_named_above_the_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch, {**REPORTED, "touch": {"failed_passes": 7}})
    assert "7 passes failed" in capsys.readouterr().out.splitlines()[1]


def test_json_is_the_whole_answer(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, REPORTED, "--json") == 0
    assert json.loads(capsys.readouterr().out) == REPORTED


@pytest.mark.parametrize("reported", [None, {"state": "FAULT"}])
def test_the_exit_code_is_1_without_an_answer_and_in_a_fault(
    reported: dict[str, Any] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, reported) == 1


def test_without_a_daemon_one_sentence_says_what_starts_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", "--endpoint", str(tmp_path)]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert str(tmp_path) in printed.err
    assert "hapticd run" in printed.err
