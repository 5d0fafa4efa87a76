"""The report of experiments other than the paper's: thresholds by participant and condition, ratings, d'."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from people import answered, write
from test_experiment import BARE, QUEST
from test_report import outcome, rows

from hapticd_study.experiment import parse
from hapticd_study.session import Session

RATED: dict[str, Any] = {
    "name": "roughness",
    "question": "How rough is it?",
    "answers": {"1": "smooth", "2": "", "3": "rough"},
    "factors": {"period_mm": [1.0, 2.0]},
    "trials": 8,
    "plate": {"targets": [{"finger": 1, "grating": {"period_mm": "$period_mm", "high_um": 1.0}}]},
}
STIMULI: dict[str, Any] = {
    **RATED,
    "name": "stimuli",
    "answers": {"rougher": "", "smoother": ""},
    "factors": {"hand": ["left", "right"], "um": [0.2, 0.4, 0.6, 0.8]},
    "curve": "um",
    "trials": 160,
    "plate": {"targets": [{"finger": 1, "amplitude_um": "$um"}]},
}


def held(participant: str, table: dict[str, Any], rule: Callable[[Any], str]) -> Session:
    """A whole session whose participant answers a trial so."""
    return answered(Session(participant, 3, parse(table)), rule)


@pytest.mark.parametrize("adaptive", [BARE["adaptive"], {**QUEST, "levels": [0.1 * step for step in range(11)]}])
def test_an_adaptive_session_s_threshold_is_reported(
    adaptive: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = {**BARE, "adaptive": adaptive, "trials": 40}

    def sharp(trial: Any) -> str:
        wrong = "first" if trial.correct == "second" else "second"
        return trial.correct if trial.levels["level"] > 0.35 or trial.is_standard_first else wrong

    write(tmp_path, held("P1", table, sharp))
    code, output, _ = outcome(capsys, "report", str(tmp_path), "--json", str(tmp_path / "f.json"))
    assert code == 0
    assert "threshold" in output
    (curve,) = json.loads((tmp_path / "f.json").read_text())["curves"]
    low, high = curve["curve"]["threshold_interval"]
    assert 0.15 < curve["curve"]["threshold"] < 0.55
    assert low < curve["curve"]["threshold"] < high
    assert rows(tmp_path / "trials.csv")[0]["level"] != ""


def test_constant_stimuli_have_a_curve_for_each_other_condition(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def left_is_duller(trial: Any) -> str:
        threshold_um = 0.7 if trial.levels["hand"] == "left" else 0.3
        return "rougher" if trial.levels["um"] > threshold_um else "smoother"

    write(tmp_path, held("P1", STIMULI, left_is_duller))
    _, output, complaint = outcome(capsys, "report", str(tmp_path), "--json", str(tmp_path / "f.json"))
    curves = {one["condition"]["hand"]: one for one in json.loads((tmp_path / "f.json").read_text())["curves"]}
    assert 0.6 < curves["left"]["curve"]["threshold"] < 0.8
    assert 0.2 < curves["right"]["curve"]["threshold"] < 0.4
    assert "hand left" in output
    assert "wrote trials.csv in" in complaint  # no success rates: no answer is right
    assert not (tmp_path / "results.csv").exists()


def test_ratings_have_their_mean_by_condition(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for participant, offset in (("P1", 0), ("P2", 1)):
        write(tmp_path, held(participant, RATED, lambda trial, by=offset: str(int(trial.levels["period_mm"]) + by)))
    _, output, _ = outcome(capsys, "report", str(tmp_path))
    lines = [line.split() for line in output.splitlines() if "period_mm" in line]
    assert lines == [["8", "1.500", "0.535", "period_mm", "1.0"], ["8", "2.500", "0.535", "period_mm", "2.0"]]


def test_experiments_are_not_mixed(tmp_path: Path, refused: Callable[..., str]) -> None:
    write(tmp_path, held("P1", RATED, lambda _: "1"))
    write(tmp_path, held("P2", {**RATED, "name": "other"}, lambda _: "1"))
    assert "mixes experiments (P1: roughness, P2: other)" in refused("report", str(tmp_path))
