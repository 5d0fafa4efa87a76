"""Trials for other programs: names and tables of BIDS."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hapticd_study import dataset
from hapticd_study.experiment import StudyError

HEAD = ("participant", "trial", "level", "answer", "recognised", "felt_friction", "t_daemon_ns", "simulated")
TABLE = (
    ("P-03", 1, 0.5, "low", 1, 0.25, 12, "plate"),
    ("P-03", 2, "high", "high", 0, None, None, "plate"),
    ("P4", 1, 0.5, "low", None, 0.5, 14, "plate"),
)
ROWS = [dict(zip(HEAD, row, strict=True)) for row in TABLE]


def test_each_participant_has_a_table_and_recordings_under_names_of_bids(tmp_path: Path) -> None:
    for name in ("P-03.mcap", "P-03.2.mcap", "P4.mcap", "P5.mcap"):
        (tmp_path / name).write_text(name)
    out = tmp_path / "out"
    for _ in range(2):  # the second over those of the first
        written = dataset.write_bids(ROWS, "my-task", out, tmp_path)
    assert sorted(str(path.relative_to(out)) for path in written) == [
        "dataset_description.json",
        "participants.tsv",
        "sub-P03/beh/sub-P03_task-mytask_beh.tsv",
        "sub-P03/beh/sub-P03_task-mytask_run-1_physio.mcap",
        "sub-P03/beh/sub-P03_task-mytask_run-2_physio.mcap",
        "sub-P4/beh/sub-P4_task-mytask_beh.tsv",
        "sub-P4/beh/sub-P4_task-mytask_physio.mcap",
        "task-mytask_beh.json",
    ]
    table = (out / "sub-P03/beh/sub-P03_task-mytask_beh.tsv").read_text(encoding="utf-8").splitlines()
    assert table == [
        "trial\tlevel\tanswer\trecognised\tfelt_friction\tt_daemon_ns\tsimulated",
        "1\t0.5\tlow\t1\t0.25\t12\tplate",
        "2\thigh\thigh\t0\tn/a\tn/a\tplate",
    ]
    assert (out / "participants.tsv").read_text(encoding="utf-8").split() == ["participant_id", "sub-P03", "sub-P4"]
    about = json.loads((out / "task-mytask_beh.json").read_text(encoding="utf-8"))
    assert set(about) == {"TaskName", *table[0].split("\t")}
    assert (out / "sub-P03/beh/sub-P03_task-mytask_run-2_physio.mcap").read_text() == "P-03.2.mcap"


def test_a_folder_of_other_files_and_participants_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(StudyError, match="holds other files: give an empty folder, or add --force"):
        dataset.write_bids(ROWS, "task", tmp_path)
    with pytest.raises(StudyError, match="two would be alike: rename one"):
        dataset.write_bids([*ROWS, {**ROWS[0], "participant": "P03"}], "task", tmp_path / "out")
