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

from hapticd.__main__ import main
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim.settings import Settings
from hapticd.tools.record import export, simulated
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


def test_a_finger_without_a_target_has_its_pressure_and_its_contact(tmp_path: Path) -> None:
    path = tmp_path / "press.mcap"
    simulated.run("press", path, settings=Settings(), seed=3, seconds=1.5)
    found = tables(open_recording(path))["fingers"]
    pressure_frac, area_mm2 = found["pressure_frac"], found["area_mm2"]
    assert 0.0 < pressure_frac.min() < 0.2 < 0.5 < pressure_frac.max()
    assert area_mm2[pressure_frac > 0.5].min() > 1.5 * area_mm2[pressure_frac < 0.2].max()
    assert area_mm2 == pytest.approx(np.pi / 4 * found["major_mm"] * found["minor_mm"])


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


def test_one_call_writes_all_formats_and_pandas_reads_the_parquet(
    tmp_path: Path, strokes: Path, refused: Callable[..., str]
) -> None:
    assert "--csv DIR, --hdf5 F.h5, --parquet DIR" in refused("export", str(strokes))
    forms = ["--parquet", str(tmp_path), "--csv", str(tmp_path), "--hdf5", str(tmp_path / "s.h5")]
    assert main(["export", str(strokes), *forms]) == 0

    assert {path.suffix for path in tmp_path.iterdir()} == {".parquet", ".csv", ".json", ".h5"}
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


def test_the_picture_is_drawn_with_truth_and_without(tmp_path: Path, strokes: Path, eventful: Path) -> None:
    for recording in (strokes, eventful):
        out = tmp_path / f"{recording.stem}.png"
        assert main(["export", str(recording), "--plot", str(out)]) == 0
        assert out.read_bytes().startswith(PNG)


@pytest.mark.parametrize("span", [("9", "10"), ("1", "0.5")])
def test_a_part_that_is_not_there_is_one_sentence(
    span: tuple[str, str], tmp_path: Path, strokes: Path, refused: Callable[..., str]
) -> None:
    complaint = refused("export", str(strokes), "--plot", str(tmp_path / "a.png"), "--from", span[0], "--to", span[1])
    assert "there is nothing" in complaint
