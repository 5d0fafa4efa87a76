"""Other programs' formats, opened by those programs; and the picture."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas
import pytest

from hapticd.__main__ import main
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim.settings import Settings
from hapticd.tools.record import simulated
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
    assert ((found["targets"]["felt_frac"] >= 0.0) & (found["targets"]["felt_frac"] <= 1.0)).all()
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


def test_pandas_and_h5py_read_all_formats_of_one_call(
    tmp_path: Path, eventful: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "--csv DIR, --hdf5 F.h5, --parquet DIR" in refused("export", str(eventful))
    forms = ["--parquet", str(tmp_path), "--csv", str(tmp_path), "--hdf5", str(tmp_path / "s.h5")]
    assert main(["export", str(eventful), *forms]) == 0
    assert "passes" in capsys.readouterr().out

    assert {path.suffix for path in tmp_path.iterdir()} == {".parquet", ".csv", ".json", ".h5"}
    with h5py.File(tmp_path / "s.h5") as file:
        for name, table in tables(open_recording(eventful)).items():
            hdf5 = pandas.DataFrame(file[name][:])
            hdf5 = hdf5.map(lambda value: value.decode() if isinstance(value, bytes) else value)
            csv = pandas.read_csv(tmp_path / f"{name}.csv")
            parquet = pandas.read_parquet(tmp_path / f"{name}.parquet")
            assert list(hdf5) == list(csv) == list(parquet) == list(table)
            for column, values in table.items():
                is_text = values.dtype == object
                for frame in (hdf5, parquet) if is_text else (hdf5, parquet, csv):  # CSV has no types
                    np.testing.assert_array_equal(frame[column], values)
        messages = map(json.loads, pandas.read_csv(tmp_path / "messages.csv")["message_json"])
        assert {"v", "client", "ttl_s", "targets"} <= set(next(message for message in messages if "targets" in message))
        header = json.loads((tmp_path / "header.json").read_text(encoding="utf-8"))
        assert header == {**file.attrs}
    assert set(header) == {"hapticd", "started_utc", "t_start_ns", "trackpad_model", "config_toml", "units"}


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


def test_the_picture_is_drawn_with_truth_and_without(tmp_path: Path, strokes: Path, eventful: Path) -> None:
    for recording in (strokes, eventful):
        out = tmp_path / f"{recording.stem}.png"
        assert main(["export", str(recording), "--plot", str(out)]) == 0
        assert out.read_bytes().startswith(PNG)


def test_what_cannot_be_written_or_drawn_is_one_sentence(
    tmp_path: Path, strokes: Path, refused: Callable[..., str]
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "below: cannot be created" in refused("export", str(strokes), "--csv", str(tmp_path / "file" / "below"))
    for start_s, end_s in (("9", "10"), ("1", "0.5")):
        drawn = ["--plot", str(tmp_path / "a.png"), "--from", start_s, "--to", end_s]
        assert "there is nothing" in refused("export", str(strokes), *drawn)
