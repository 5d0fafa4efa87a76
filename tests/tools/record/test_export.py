"""Other programs' formats, opened by those programs; and the picture."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas
import pytest
from pictures import faults

from hapticd.__main__ import main
from hapticd.errors import RecordingError
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim import lockstep
from hapticd.tools.record import export, picture, simulated
from hapticd.tools.record.tables import TABLES, tables

pytestmark = pytest.mark.long

PNG = b"\x89PNG\r\n\x1a\n"


def test_the_tables_hold_what_the_records_do(strokes: Path) -> None:
    recording = open_recording(strokes)
    records = list(recording.records())
    found = tables(recording)
    passes = [record for record in records if record.kind == "pass"]

    assert len(found["passes"]["t_ns"]) == len(passes)
    assert len(found["fingers"]["x_mm"]) == sum(len(record.fields["fingers"]) for record in passes)
    assert len(found["references"]["mode"]) == 2 * sum(len(record.fields.get("knots", [])) for record in passes)
    assert set(found["targets"]["finger_id"]) == {"1", "2"}
    assert set(found["targets"]["target_um"]) == {0.0, 1.0}
    assert found["targets"]["friction_change"].min() < -0.2 < 0.2 < found["targets"]["friction_change"].max()
    assert ((found["targets"]["weber_frac"] >= 0.0) & (found["targets"]["weber_frac"] <= 1.0)).all()
    assert np.abs(np.hypot(found["truth"]["plate_d_um"], found["truth"]["plate_q_um"])).max() < 4.4
    late_ms = found["ledger"]["late_ns"] * 1e-6
    assert np.abs(late_ms).max() < 1.0
    for name, table in found.items():
        assert list(table) == ["t_s", "t_ns", *TABLES[name]]
        np.testing.assert_allclose(table["t_s"], (table["t_ns"] - recording.header.t_start_ns) * 1e-9)


def test_every_table_is_filled_by_some_event(strokes: Path, eventful: Path) -> None:
    filled = set(tables(open_recording(strokes))) | set(tables(open_recording(eventful)))

    assert filled == set(TABLES)
    markers = tables(open_recording(eventful))["markers"]
    assert (list(markers["client"]), list(markers["text"])) == (["test"], ["trial 1 begins"])


def test_pandas_reads_the_csv(tmp_path: Path, eventful: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(eventful), "--csv", str(tmp_path / "out")]) == 0

    found = tables(open_recording(eventful))
    for name, table in found.items():
        frame = pandas.read_csv(tmp_path / "out" / f"{name}.csv")
        assert list(frame) == list(table)
        np.testing.assert_array_equal(frame["t_ns"], table["t_ns"])
    messages = pandas.read_csv(tmp_path / "out" / "messages.csv")["message_json"].map(json.loads)
    assert {"v", "client", "ttl_s", "targets"} <= set(messages[0])
    assert isinstance(messages.iloc[-1], dict)
    header = json.loads((tmp_path / "out" / "header.json").read_text(encoding="utf-8"))
    assert "[solver]" in header["config_toml"]
    assert set(header) == {"hapticd", "started_utc", "t_start_ns", "trackpad_model", "config_toml", "units"}
    assert "passes" in capsys.readouterr().out


def test_a_full_disk_under_the_hdf5_is_one_line(strokes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(strokes), "--hdf5", "/dev/full"]) == 1
    assert capsys.readouterr().err.startswith("hapticd: /dev/full: cannot be written (No space left on device)")


def test_pandas_and_h5py_read_the_hdf5(tmp_path: Path, strokes: Path) -> None:
    path = tmp_path / "out.h5"
    assert main(["export", str(strokes), "--hdf5", str(path)]) == 0

    with h5py.File(path) as file:
        assert file.attrs["trackpad_model"] == "mt2-usb"
        assert "_um: micrometres peak to peak" in file.attrs["units"]
        for name, table in tables(open_recording(strokes)).items():
            frame = pandas.DataFrame(file[name][:])
            assert list(frame) == list(table)
            numbers = [column for column, values in table.items() if values.dtype.kind in "if"]
            for column in numbers:
                np.testing.assert_array_equal(frame[column], table[column])
        assert set(file["passes"]["state"]) <= {b"IDLE", b"ARMED", b"ACTIVE", b"STOPPED"}


def test_the_readme_s_lines_give_texts_that_match(
    tmp_path: Path, strokes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(strokes), "--hdf5", "s.h5"]) == 0
    readme = (Path(export.__file__).parent / "README.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    names: dict[str, Any] = {"h5py": h5py, "pandas": pandas}
    exec(lines, names)
    targets = tables(open_recording(strokes))["targets"]
    assert names["frame"]["finger_id"].tolist() == targets["finger_id"].tolist()
    assert (names["frame"]["finger_id"] == "1").any()
    np.testing.assert_array_equal(names["frame"]["target_um"], targets["target_um"])


def test_pandas_reads_the_parquet(tmp_path: Path, strokes: Path) -> None:
    assert main(["export", str(strokes), "--parquet", str(tmp_path)]) == 0

    for name, table in tables(open_recording(strokes)).items():
        frame = pandas.read_parquet(tmp_path / f"{name}.parquet")
        for column, values in table.items():
            assert (
                frame[column].tolist() == pytest.approx(values.tolist(), nan_ok=True)
                if values.dtype.kind == "f"
                else (frame[column].tolist() == values.tolist())
            )


@pytest.mark.parametrize(("library", "flag"), [("h5py", "--hdf5"), ("pyarrow", "--parquet")])
def test_a_missing_library_is_one_sentence_that_says_what_installs_it(
    library: str,
    flag: str,
    tmp_path: Path,
    strokes: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, library, None)

    assert main(["export", str(strokes), flag, str(tmp_path / "out.h5")]) == 1
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert f"run `{sys.executable} -m pip install 'h5py>=" in printed


@pytest.mark.parametrize("form", ["--csv", "--parquet"])
def test_a_folder_that_cannot_be_created_is_one_sentence(
    form: str, tmp_path: Path, strokes: Path, refused: Callable[..., str]
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")

    assert "below: cannot be created" in refused("export", str(strokes), form, str(tmp_path / "file" / "below"))


def test_ground_truth_targets_and_fingers_share_one_finger_id(strokes: Path) -> None:
    found = tables(open_recording(strokes))
    truth, seen = found["truth"], found["fingers"]
    late = truth["t_s"] > 0.8
    assert set(truth["finger_id"][late]) == set(found["targets"]["finger_id"]) == {"1", "2"}
    assert set(truth["path"]) == {1, 2}
    for finger_id in (1, 2):
        its, sampled = truth["finger_id"] == str(finger_id), seen["finger_id"] == finger_id
        for name in ("x_mm", "y_mm"):
            t_sampled_s = truth["t_s"][0] + (seen["t_sample_ns"][sampled] - truth["t_ns"][0]) * 1e-9
            true_mm = np.interp(t_sampled_s, truth["t_s"][its], truth[name][its])
            assert np.abs(seen[name][sampled] - true_mm).max() < 3.0


def test_a_virtual_finger_has_its_name_in_the_ground_truth(tmp_path: Path) -> None:
    path = tmp_path / "virtual.mcap"
    simulated.run("virtual-finger", path, settings=lockstep.Settings(), seed=1, seconds=0.8)
    found = tables(open_recording(path))
    assert set(found["truth"]["finger_id"][found["truth"]["t_s"] > 0.7]) == set(found["targets"]["finger_id"])


def test_the_picture_is_drawn_with_truth_and_without(tmp_path: Path, strokes: Path, eventful: Path) -> None:
    for recording in (strokes, eventful):
        out = tmp_path / f"{recording.stem}.png"
        assert main(["plot", str(recording), str(out)]) == 0
        assert out.read_bytes().startswith(PNG)


@pytest.mark.parametrize("span", [("9", "10"), ("1", "0.5")])
def test_a_part_that_is_not_there_is_one_sentence(
    span: tuple[str, str], tmp_path: Path, strokes: Path, refused: Callable[..., str]
) -> None:
    complaint = refused("plot", str(strokes), str(tmp_path / "a.png"), "--from", span[0], "--to", span[1])
    assert "there is nothing" in complaint


@pytest.mark.parametrize("name", ["strokes", "eventful"])
def test_every_line_of_a_part_begins_and_ends_at_its_edges(
    name: str, tmp_path: Path, request: pytest.FixtureRequest, figures: list[Any]
) -> None:
    recording = open_recording(request.getfixturevalue(name))
    for part in ({}, {"start_s": 0.9, "end_s": 1.1}):
        picture.draw(tables(recording), tmp_path / "out.png", **part)
    whole, part = figures
    for axis, zoomed in zip(whole.axes[-4:], part.axes[-4:], strict=True):  # below the markers
        lines = [line for line in axis.lines if line.get_marker() == "None" and len(line.get_xdata()) > 2]
        reached = [line for line in lines if line.get_xdata().min() < 0.9 and line.get_xdata().max() > 1.1]
        drawn = [line for line in zoomed.lines if line.get_marker() == "None" and len(line.get_xdata()) > 1]
        assert len(drawn) >= len(reached)
        spans = [(line.get_xdata().min(), line.get_xdata().max()) for line in drawn]
        assert spans.count((0.9, 1.1)) >= len(reached)


def test_a_session_of_many_touches_has_a_legend_of_two_rows(
    strokes: Path, tmp_path: Path, figures: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture, "LIFTED_S", 0.001)  # each instant is a touch of its own
    found = tables(open_recording(strokes))
    truth = {name: column[::100] for name, column in found["truth"].items()}
    truth["finger_id"] = np.arange(len(truth["t_s"])).astype(str).astype(object)
    picture.draw(found | {"truth": truth}, tmp_path / "out.png")
    words = [text.get_text() for text in figures[0].axes[3].get_legend().get_texts()]
    assert len(words) == 10
    assert words[-1] == "targets"


def test_markers_close_to_each_other_and_to_the_end_cover_no_text(
    strokes: Path, tmp_path: Path, figures: list[Any]
) -> None:
    found = tables(open_recording(strokes))
    end_s = float(found["passes"]["t_s"][-1])
    t_s = np.array([0.1, 0.12, 0.3, 0.33, 0.35, end_s - 0.02, end_s - 0.01])
    words = ["trial 1 begins", "a text that is longer than is shown", "cue", "left", "answer: right", "trial 2", "end"]
    markers = {"t_s": t_s, "text": np.array(words, dtype=object)}
    picture.draw(found | {"markers": markers}, tmp_path / "out.png", title="strokes.mcap, of a long session")
    strip, *pictures = figures[0].axes
    assert [text.get_text().strip() for text in strip.texts] == [words[0], "a text that is longer t…", *words[2:]]
    assert all(sum(line.get_ls() == ":" for line in axis.lines) == len(words) for axis in pictures)
    assert faults(figures[0]) == []


def test_of_more_markers_than_have_room_some_are_lines_only(strokes: Path, tmp_path: Path, figures: list[Any]) -> None:
    found = tables(open_recording(strokes))
    count = 40
    markers = {"t_s": np.linspace(0.2, 0.3, count), "text": np.full(count, "trial", dtype=object)}
    picture.draw(found | {"markers": markers}, tmp_path / "out.png")
    strip, *pictures = figures[0].axes
    assert 0 < len(strip.texts) < count
    assert sum(line.get_ls() == ":" for line in pictures[0].lines) == count
    assert faults(figures[0]) == []


def test_a_recording_without_a_pass_has_no_picture(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nothing to draw"):
        picture.draw({}, tmp_path / "a.png")


def test_a_picture_without_fingers_says_so_and_does_not_magnify_the_plates_noise(
    tmp_path: Path, figures: list[Any]
) -> None:
    simulated.run("hands", tmp_path / "hands.mcap", settings=lockstep.Settings(), seed=1, seconds=0.4)
    picture.draw(tables(open_recording(tmp_path / "hands.mcap")), tmp_path / "out.png")
    x, y, modes, fingers = figures[0].axes
    for axis in (x, y, fingers):
        assert [text.get_text() for text in axis.texts] == ["no finger touches"]
    assert modes.get_ylim() == pytest.approx((-0.1, 0.1), rel=0.15)
