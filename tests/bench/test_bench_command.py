"""`hapticd bench` on the command line: where tables, JSON and the picture go, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.bench import firmware, solver, stability, suite
from hapticd.errors import HapticdError


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two parts of tiny sizes in place of all."""
    parts = {
        "solver": lambda _: (solver.run(problems=20, repeats=1, timed=2),),
        "firmware": lambda _: firmware.run(
            frequencies_hz=(5.0,), speeds_mm_s=(100.0,), qualities=(500.0,), repeats=1, ticks=5
        ),
    }
    monkeypatch.setattr(suite, "PARTS", parts)


def test_the_command_knows_every_part() -> None:
    assert list(suite.PARTS) == [
        "modes",
        "prediction",
        "solver",
        "knots",
        "stability",
        "tick",
        "recording",
        "leak",
        "firmware",
        "soak",
    ]


@pytest.mark.usefixtures("quick")
def test_all_parts_are_told_as_tables_json_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures, picture = tmp_path / "bench.json", tmp_path / "bench.png"
    assert main(["bench", "all", "--json", str(figures), "--plot", str(picture)]) == 0
    told = json.loads(figures.read_text(encoding="utf-8"))
    assert {part: list(tables) for part, tables in told["parts"].items()} == {
        "solver": ["solver"],
        "firmware": ["step", "corners", "tracking", "strokes"],
    }
    assert told["machine"]["cpu_count"] >= 1
    assert picture.read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert "solve_fast" in out
    assert "pi_ff" in out
    assert str(picture) in out


def test_a_picture_leaves_out_the_tables_that_are_for_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(suite.PARTS, "stability", lambda extent: stability.run(problems=1, steps=extent.steps))
    picture = tmp_path / "bench.png"
    assert main(["bench", "stability", "--steps", "100", "--plot", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("quick")
def test_json_on_standard_output_stands_there_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "firmware", "--json", "-"]) == 0
    streams = capsys.readouterr()
    assert list(json.loads(streams.out)["parts"]) == ["firmware"]
    assert "pi_ff" in streams.err


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    "arguments",
    [["--plot", "nowhere/bench.png"], ["--json", "nowhere/bench.json"], ["--seconds", "nan"], ["--steps", "-1"]],
)
def test_what_cannot_be_done_is_one_sentence_before_anything_runs(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "solver", *arguments]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert streams.err.startswith("hapticd: ")
    assert len(streams.err.splitlines()) == 1


@pytest.mark.usefixtures("quick")
def test_a_picture_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match="is a directory: name a file in it"):
        suite.run("solver", seconds=0.0, json_file=None, plot=tmp_path)
