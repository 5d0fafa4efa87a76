"""`hapticd bench` on the command line: tables, JSON, and refused arguments."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.bench import command as bench
from hapticd.bench import firmware, solver


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two parts of tiny sizes in place of all."""
    parts = {
        "solver": lambda: solver.run(problems=20, repeats=1, timed=2),
        "firmware": lambda: firmware.run(repeats=1, ticks=5),
    }
    monkeypatch.setattr(bench, "measure", lambda name, _: parts[name]())
    monkeypatch.setattr(bench, "PARTS", {name: bench.PARTS[name] for name in parts})


def test_without_a_part_the_parts_are_listed_with_their_time_and_nothing_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "measure", lambda *_: pytest.fail("it runs"))
    assert main(["bench"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in (*bench.PARTS, "all"):
        assert [line for line in lines if re.match(rf"  {name} +[\d.]+ min  \w", line)]
    total = sum(part.minutes for name, part in bench.PARTS.items() if name != bench.APART)
    assert any(f"{total:g} min  all of these but worlds" in line for line in lines)


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_all_parts_give_tables_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures = tmp_path / "bench.json"
    assert main(["bench", "all", "--json", str(figures)]) == 0
    written = json.loads(figures.read_text(encoding="utf-8"))
    tables = {part: list(tables) for part, tables in written["parts"].items()}
    assert tables == {"solver": ["solver"], "firmware": ["firmware"]}
    assert written["machine"]["cpu_count"] >= 1
    out = capsys.readouterr().out
    assert "solve_batch" in out
    assert "pi_ff" in out


@pytest.mark.parametrize(
    "arguments",
    [["--json", "nowhere/bench.json"], ["--worlds", "5"], ["--keep", "results"], ["--worlds", "0"]],
)
def test_a_wrong_argument_is_one_sentence_before_anything_runs(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(bench, "measure", lambda *_: pytest.fail("it runs"))
    assert main(["bench", "solver", *arguments]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.startswith("hapticd: ")
    assert arguments[0] in streams.err or arguments[1] in streams.err
    assert len(streams.err.splitlines()) == 1
