"""The report of a folder, and refused command lines."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from people import session, write
from test_analysis import PAPER

from hapticd.__main__ import main
from hapticd.tools.study.session import read

pytestmark = pytest.mark.long


@pytest.fixture
def papers(tmp_path: Path) -> Path:
    """The paper's seven participants, with the constructed counts."""
    for place, correct in enumerate(PAPER, 1):
        write(tmp_path, session(f"P{place}", correct, seed=place))
    return tmp_path


def outcome(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(["study", *arguments])
    output = capsys.readouterr()
    return code, output.out, output.err


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_paper_s_numbers_make_the_paper_s_sentence(papers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, output, complaint = outcome(capsys, "report", str(papers))
    assert (code, complaint) == (0, f"wrote results.csv, trials.csv, figure-12.png in {papers}\n")
    assert "average success rate 73.57 %, standard deviation 17.73 % (7 participants)" in output
    assert "103 of 140 trials together" in output
    assert "t(6) = 3.52                     p = 0.013" in output
    assert "6 above 50 %, 0 below" in output


def test_the_tables_hold_every_participant_and_every_trial(papers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outcome(capsys, "report", str(papers))
    assert (papers / "figure-12.png").read_bytes().startswith(b"\x89PNG")
    people, trials = rows(papers / "results.csv"), rows(papers / "trials.csv")
    assert [int(row["recognised"]) for row in people[:7]] == list(PAPER)
    assert [row["participant"] for row in people[7:]] == ["average", "standard deviation"]
    assert float(people[7]["success_rate_percent"]) == pytest.approx(100 * 103 / 140)
    assert float(people[8]["success_rate_percent"]) == pytest.approx(17.728, abs=1e-3)
    assert len(trials) == 140
    for row in trials:
        assert row["friction"] == row["presented"]
        assert (row["recognised"] == "1") == (row["presented"] == row["answer"])
    assert sum(int(row["recognised"]) for row in trials if row["participant"] == "P7") == PAPER[6]


def test_a_report_is_repeated_over_its_own_files_with_the_sessions_that_came_since(
    papers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = outcome(capsys, "report", str(papers))
    assert outcome(capsys, "report", str(papers)) == first
    write(papers, session("P8", 20, seed=8))
    assert "(8 participants)" in outcome(capsys, "report", str(papers))[1]
    assert [row["participant"] for row in rows(papers / "results.csv")][7] == "P8"


def test_the_figures_as_json_are_alone_on_standard_output(papers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, output, complaint = outcome(capsys, "report", str(papers), "--json", "-")
    figures = json.loads(output)
    assert "average success rate" in complaint
    assert figures["group"]["mean_frac"] == pytest.approx(103 / 140)
    assert [person["correct"] for person in figures["participants"]] == list(PAPER)


def test_a_session_that_is_not_finished_stays_blind(papers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(papers, session("P8", 20, seed=8), answers=19)
    _, output, complaint = outcome(capsys, "report", str(papers))
    assert "P8" not in output
    assert complaint.startswith("not finished, so not analysed: P8 (19 of 20)\n")
    assert "P8" not in (papers / "trials.csv").read_text()


def test_a_copy_of_a_session_does_not_count_twice(papers: Path, refused: Callable[..., str]) -> None:
    (papers / "P3 (copy).jsonl").write_bytes((papers / "P3.jsonl").read_bytes())
    assert "is P3's, as" in refused("study", "report", str(papers))


@pytest.mark.parametrize("answers", [None, 3])
def test_a_folder_without_a_finished_session_is_one_sentence(
    answers: int | None, tmp_path: Path, refused: Callable[..., str]
) -> None:
    if answers is not None:
        write(tmp_path, session("P1", 9), answers=answers)
    complaint = refused("study", "report", str(tmp_path))
    assert complaint.startswith(f"hapticd: {tmp_path}: holds no finished session")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--participant", "a/b"), "must be 1 .. 32 letters"),
        (("--participant", "P1", "--trials", "0"), "trials: 0 is out of bounds"),
        (("--participant", "P1", "--seed", "-1"), "--seed: -1 is out of bounds"),
        (("--participant", "P1", "--scheme", "paper"), "give --simulate as well"),
        (("--participant", "P1", "--simulate", "--browser"), "cannot be combined with --browser"),
        (("--participant", "P1", "--sim", "--endpoint", "x"), "cannot be combined with --endpoint"),
        (("--participant", "P1", "--browser", "--page-port", "65536"), "--page-port: 65536 is out of bounds"),
        (("--participant", "P1", "--page-port", "8000"), "give --browser as well"),
        (("--participant", "P1", "--simulate", "--speed", "nan"), "--speed: nan is out of bounds"),
    ],
)
def test_conflicting_options_are_one_sentence_and_leave_no_file(
    arguments: tuple[str, ...], sentence: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    assert sentence in refused("study", "run", "--out", str(tmp_path / "new"), *arguments)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--trials", "10"), "was started with 20 trials"),
        (("--seed", "6"), "another seed"),
        (("--simulate",), "was started by a person: continue without --simulate"),
    ],
)
def test_a_continued_session_cannot_be_changed(
    arguments: tuple[str, ...], sentence: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    path = write(tmp_path, session("P1", 9), answers=3)
    before = path.read_bytes()
    assert sentence in refused("study", "run", "--participant", "P1", "--out", str(tmp_path), *arguments)
    assert path.read_bytes() == before


def test_without_a_daemon_the_answers_so_far_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, session("P1", 9), answers=3)
    arguments = ("--participant", "P1", "--out", str(tmp_path), "--endpoint", str(tmp_path / "none"))
    code, _, complaint = outcome(capsys, "run", *arguments)
    assert code == 1
    assert complaint.endswith("The answers are kept: continue with the same command.\n")
    assert len(read(path).answers) == 3


def test_a_simulated_session_is_run_and_analysed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--participant", "S1", "--out", str(tmp_path), "--seed", "1", "--trials", "2", "--simulate")
    code, output, complaint = outcome(capsys, "run", *arguments, "--scheme", "paper")
    assert (code, complaint) == (0, "")
    assert output.startswith(f"2 of 2 answers in {tmp_path}/S1.jsonl")
    _, output, complaint = outcome(capsys, "report", str(tmp_path))
    assert "of 2" in output
    assert "(1 simulated participant)" in output
    assert complaint.startswith("simulated participants: this is no evidence about people on glass.\n")


SAID = {
    "": "7 participants",
    "participant": "7 simulated participants",
    "plate": "7 participants on the simulated plate",
}


@pytest.mark.parametrize("simulated", SAID)
def test_each_output_tells_what_was_simulated_and_the_figure_its_number_and_error_bar(
    simulated: str, tmp_path: Path, figures: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    for place, correct in enumerate(PAPER, 1):
        about = {"simulated": simulated} if simulated else {}
        write(tmp_path, replace(session(f"P{place}", correct, seed=place), about=about))
    _, output, complaint = outcome(capsys, "report", str(tmp_path), "--json", str(tmp_path / "f.json"))

    who = SAID[simulated]
    assert f"({who})" in output
    assert ("no evidence about people" in complaint) is bool(simulated)
    for table in ("results.csv", "trials.csv"):
        assert {row["simulated"] for row in rows(tmp_path / table)} == {simulated}
    assert json.loads((tmp_path / "f.json").read_text())["simulated"] == (simulated or None)
    (axes,) = figures[0].axes
    assert axes.get_title() == f"{who}, 20 trials each"
    assert axes.get_xticklabels()[-1].get_text() == "average ± SD\nn = 7"


def test_real_and_simulated_sessions_are_not_mixed(papers: Path, refused: Callable[..., str]) -> None:
    write(papers, replace(session("P8", 20), about={"simulated": "plate"}))
    write(papers, replace(session("P9", 20), about={"simulated": True}))
    who = "P1 P2 P3 P4 P5 P6 P7: real, P8: simulated plate, P9: simulated"
    assert f"mixes real and simulated sessions ({who}" in refused("study", "report", str(papers))
    assert not (papers / "results.csv").exists()
