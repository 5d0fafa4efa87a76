"""`hapticd bench` on the command line: tables, JSON, the picture, and refused arguments."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.bench import command as bench
from hapticd.bench import firmware, solver, suite, worlds

pytestmark = pytest.mark.long


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two parts of tiny sizes in place of all."""
    parts = {
        "solver": lambda _: (solver.run(problems=20, repeats=1, timed=2),),
        "firmware": lambda _: firmware.run(repeats=1, ticks=5),
    }
    monkeypatch.setattr(suite, "PARTS", parts)
    monkeypatch.setattr(bench, "PARTS", {name: bench.PARTS[name] for name in parts})


def test_the_command_knows_every_part() -> None:
    assert [*suite.PARTS] == [*bench.PARTS]
    assert worlds.WORLDS == bench.WORLDS


def test_without_a_part_the_parts_are_listed_with_the_time_they_take_and_nothing_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(suite, "run", lambda *_, **__: pytest.fail("it runs"))
    assert main(["bench"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in (*bench.PARTS, "all"):
        assert [line for line in lines if re.match(rf"  {name} +[\d.]+ min  \w", line)]
    total = sum(part.minutes for name, part in bench.PARTS.items() if name not in bench.APART)
    assert any(f"{total:g} min  all of these but worlds" in line for line in lines)


@pytest.mark.usefixtures("quick")
def test_all_parts_give_tables_json_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures, picture = tmp_path / "bench.json", tmp_path / "bench.png"
    assert main(["bench", "all", "--json", str(figures), "--plot", str(picture)]) == 0
    written = json.loads(figures.read_text(encoding="utf-8"))
    assert {part: list(tables) for part, tables in written["parts"].items()} == {
        "solver": ["solver"],
        "firmware": ["step", "tracking"],
    }
    assert written["machine"]["cpu_count"] >= 1
    assert picture.read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert "solve_batch" in out
    assert "pi_ff" in out
    assert str(picture) in out


@pytest.mark.usefixtures("quick")
def test_a_picture_of_tables_without_run_times_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(suite.PARTS, "worlds", lambda _: pytest.fail("it is measured first"))
    monkeypatch.setitem(bench.PARTS, "worlds", bench.Part("laboratories", 1.0, has_picture=False))
    assert main(["bench", "worlds", "--plot", str(tmp_path / "bench.png")]) == 2
    assert "worlds has no table of error over run time" in capsys.readouterr().err
    assert not (tmp_path / "bench.png").exists()


@pytest.mark.usefixtures("quick")
def test_json_on_standard_output_is_all_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "firmware", "--json", "-"]) == 0
    streams = capsys.readouterr()
    assert list(json.loads(streams.out)["parts"]) == ["firmware"]
    assert "pi_ff" in streams.err


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    "arguments",
    [["--plot", "nowhere/bench.png"], ["--json", "nowhere/bench.json"], ["--seconds", "nan"]],
)
def test_a_wrong_argument_is_one_sentence_before_anything_runs(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "solver", *arguments]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.startswith("hapticd: ")
    assert len(streams.err.splitlines()) == 1
