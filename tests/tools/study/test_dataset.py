"""Trials for other programs: names and tables of BIDS, and Parquet."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet
import pytest

from hapticd.tools.study import dataset
from hapticd.tools.study.experiment import StudyError

TABLE = [
    ["participant", "trial", "level", "answer", "recognised", "felt_friction", "t_daemon_ns"],
    ["P-03", 1, 0.5, "low", 1, 0.25, 12],
    ["P-03", 2, "high", "high", 0, None, None],
    ["P4", 1, 0.5, "low", None, 0.5, 14],
]


def test_each_participant_has_a_table_under_a_name_of_bids(tmp_path: Path) -> None:
    rows = dataset.rows_of(TABLE, "plate")
    written = dataset.write_bids(rows, "my-task", tmp_path / "out")
    names = sorted(str(path.relative_to(tmp_path / "out")) for path in written)
    assert names == [
        "dataset_description.json",
        "participants.tsv",
        "sub-P03/beh/sub-P03_task-mytask_beh.tsv",
        "sub-P4/beh/sub-P4_task-mytask_beh.tsv",
        "task-mytask_beh.json",
    ]
    table = (tmp_path / "out" / names[2]).read_text(encoding="utf-8").splitlines()
    assert table == [
        "trial\tlevel\tanswer\trecognised\tfelt_friction\tt_daemon_ns\tsimulated",
        "1\t0.5\tlow\t1\t0.25\t12\tplate",
        "2\thigh\thigh\t0\tn/a\tn/a\tplate",
    ]
    assert (tmp_path / "out" / names[1]).read_text(encoding="utf-8").split() == ["participant_id", "sub-P03", "sub-P4"]
    about = json.loads((tmp_path / "out" / names[4]).read_text(encoding="utf-8"))
    assert set(about) == {"TaskName", *table[0].split("\t")}
    assert json.loads((tmp_path / "out" / names[0]).read_text(encoding="utf-8"))["BIDSVersion"] == dataset.BIDS_VERSION
    dataset.write_bids(rows, "my-task", tmp_path / "out")  # over those of an earlier report


def test_recordings_of_the_sessions_lie_next_to_their_tables(tmp_path: Path) -> None:
    for name in ("P-03.mcap", "P-03.2.mcap", "P4.mcap", "P5.mcap"):
        (tmp_path / name).write_text(name)
    for _ in range(2):  # the second over those of the first
        written = dataset.write_bids(dataset.rows_of(TABLE, ""), "my-task", tmp_path / "out", tmp_path)
    recorded = {path.name: path.read_text() for path in written if path.suffix == ".mcap"}
    assert recorded == {
        "sub-P03_task-mytask_run-1_physio.mcap": "P-03.mcap",
        "sub-P03_task-mytask_run-2_physio.mcap": "P-03.2.mcap",
        "sub-P4_task-mytask_physio.mcap": "P4.mcap",
    }


def test_a_folder_of_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(StudyError, match="holds other files: give an empty folder, or add --force"):
        dataset.write_bids(dataset.rows_of(TABLE, ""), "task", tmp_path)


def test_two_participants_that_bids_cannot_tell_apart_are_refused(tmp_path: Path) -> None:
    rows = dataset.rows_of([TABLE[0], TABLE[1], ["P03", *TABLE[1][1:]]], "")
    with pytest.raises(StudyError, match="two would be alike: rename one"):
        dataset.write_bids(rows, "task", tmp_path / "out")


def test_parquet_has_the_same_rows_with_numbers_as_numbers(tmp_path: Path) -> None:
    dataset.write_parquet(dataset.rows_of(TABLE, ""), tmp_path / "t.parquet")
    found = pyarrow.parquet.read_table(tmp_path / "t.parquet").to_pylist()
    assert [row["t_daemon_ns"] for row in found] == [12, None, 14]
    assert [row["level"] for row in found] == ["0.5", "high", "0.5"]  # of one type in a column
    assert found[1]["felt_friction"] is None
