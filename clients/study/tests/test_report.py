"""The report of a folder of the paper's sessions, and refused command lines."""

from __future__ import annotations

import csv
import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from people import session, write
from test_analysis import PAPER

from hapticd_study import analysis, program, report
from hapticd_study.program import main
from hapticd_study.session import read


@pytest.fixture
def papers(tmp_path: Path) -> Path:
    """The paper's seven participants, with the constructed counts."""
    for place, correct in enumerate(PAPER, 1):
        write(tmp_path, session(f"P{place}", correct, seed=place))
    return tmp_path


def outcome(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(arguments)
    output = capsys.readouterr()
    return code, output.out, output.err


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_paper_s_numbers_make_the_paper_s_sentence_and_tables(
    papers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, output, complaint = outcome(capsys, "report", str(papers))
    assert (code, complaint) == (0, f"wrote results.csv, trials.csv, figure-12.png in {papers}\n")
    assert "average success rate 73.57 %, standard deviation 17.73 % (7 participants)" in output
    assert "103 of 140 trials together" in output
    assert "t(6) = 3.52                     p = 0.013" in output
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


def test_what_the_first_finger_felt_is_said_by_medians_over_the_trials(papers: Path) -> None:
    (first, *_) = report.sessions_in(papers)
    answers = [replace(first.answers[0], bias_jnd=bias, median_jnd=0.8, error_95_jnd=2.0, felt_frac=0.6,
                       within_two_frac=0.9) for bias in (-0.5, 0.1, 0.2)]  # fmt: skip
    (line,) = report.error_lines([replace(first, answers=tuple(answers))])
    assert "bias 0.10, median 0.80, 95 % 2.00 JND; within one JND 60%, two 90%" in line
    assert report.error_lines([first]) == []


def test_the_figure_has_each_rate_with_its_interval(papers: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.container import BarContainer  # half a second, in each process that collects tests
    from matplotlib.figure import Figure

    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    people = [analysis.analyse(session) for session in report.sessions_in(papers)]
    report.draw(people, analysis.analyse_group(people), papers / "figure-12.png")
    (axes,) = drawn[0].axes
    bars, _ = [one for one in axes.containers if isinstance(one, BarContainer)]
    (lines,) = bars.errorbar.lines[2]
    drawn_frac = [tuple(line[:, 1] / 100) for line in lines.get_segments()]
    assert drawn_frac == [pytest.approx(one.interval_frac) for one in people]


def test_a_report_replaces_its_own_files_and_leaves_open_sessions_blind(
    papers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = outcome(capsys, "report", str(papers))
    write(papers, session("P8", 20, seed=8), answers=19)
    _, output, complaint = outcome(capsys, "report", str(papers), "--json", "-")
    assert complaint == f"{first[1]}not finished, so not analysed: P8 (19 of 20)\n{first[2]}"
    figures = json.loads(output)
    assert figures["group"]["mean_frac"] == pytest.approx(103 / 140)
    assert [person["correct"] for person in figures["participants"]] == list(PAPER)
    assert "P8" not in output + (papers / "trials.csv").read_text()


def test_files_of_others_and_a_copied_session_are_refused(papers: Path, refused: Callable[..., str]) -> None:
    json_file = papers / "f.json"
    for path in (papers / "results.csv", papers / "figure-12.png", json_file):
        path.write_text("mine")
        assert "add --force" in refused("report", str(papers), "--json", str(json_file))
        assert path.read_text() == "mine"
        path.unlink()
    (papers / "P3 (copy).jsonl").write_bytes((papers / "P3.jsonl").read_bytes())
    assert "is P3's, as" in refused("report", str(papers))


@pytest.mark.parametrize("answers", [None, 3])
def test_a_folder_without_a_finished_session_is_one_sentence(
    answers: int | None, tmp_path: Path, refused: Callable[..., str]
) -> None:
    if answers is not None:
        write(tmp_path, session("P1", 9), answers=answers)
    assert refused("report", str(tmp_path)).startswith(f"hapticd-study: {tmp_path}: holds no finished session")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--participant", "a/b"), "must be 1 .. 32 letters"),
        (("--participant", "P1", "--trials", "0"), "trials: 0 is out of bounds"),
        (("--participant", "P1", "--seed", "-1"), "--seed: -1 is out of bounds"),
        (("--participant", "P1", "--sim", "--endpoint", "x"), "cannot be combined with --endpoint"),
        (("--participant", "P1", "--page-port", "8000"), "give --browser as well"),
    ],
)
def test_conflicting_options_are_one_sentence_and_leave_no_file(
    arguments: tuple[str, ...], sentence: str, tmp_path: Path, refused: Callable[..., str]
) -> None:
    assert sentence in refused("run", "--out", str(tmp_path / "new"), *arguments)
    assert not (tmp_path / "new").exists()


def test_a_continued_session_cannot_be_changed_and_is_kept_without_a_daemon(
    tmp_path: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, session("P1", 9), answers=3)
    before = path.read_bytes()
    arguments = ("run", "--participant", "P1", "--out", str(tmp_path))
    assert "was started with 20 trials" in refused(*arguments, "--trials", "10")
    assert "another seed" in refused(*arguments, "--seed", "6")
    monkeypatch.setattr(program, "DAEMON_WITHIN_S", 0.05)
    code, _, complaint = outcome(capsys, *arguments, "--endpoint", str(tmp_path / "none"))
    assert code == 1
    assert complaint.endswith("The answers are kept: continue with the same command.\n")
    assert path.read_bytes() == before
    assert len(read(path).answers) == 3


def test_the_note_on_an_old_curve_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    plate: Any = SimpleNamespace(person=lambda name: warnings.warn(f"The curve of {name} is old.", stacklevel=2))
    program._take_person(plate, "P1")
    assert capsys.readouterr().err == "The curve of P1 is old.\n"


def test_sessions_on_the_simulated_plate_are_marked_and_not_mixed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]
) -> None:
    write(tmp_path, replace(session("P1", 15), about={"simulated": "plate"}))
    _, output, complaint = outcome(capsys, "report", str(tmp_path), "--json", str(tmp_path / "f.json"))
    assert "(1 participant on the simulated plate)" in output
    assert "no evidence about people" in complaint
    for table in ("results.csv", "trials.csv"):
        assert {row["simulated"] for row in rows(tmp_path / table)} == {"plate"}
    assert json.loads((tmp_path / "f.json").read_text())["simulated"] == "plate"
    write(tmp_path, session("P2", 20))
    assert "mixes real and simulated plates (P1: plate, P2: paper)" in refused("report", str(tmp_path))
