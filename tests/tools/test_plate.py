"""`hapticd plate`: table, files, and refused arguments."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.design import free_plate_modes
from hapticd.files import plotting


def test_the_reference_plate_is_designed_and_its_files_are_what_they_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / f"plate.{name}" for name in ("npz", "png", "json")}
    arguments = ["--out", str(files["npz"]), "--plot", str(files["png"]), "--json", str(files["json"])]
    assert main(["plate", *arguments]) == 0
    output = capsys.readouterr().out
    assert "* 1 11x0 + 0x11" in output
    assert "121 common nodes" in output
    shapes = ModeShapes.load(files["npz"])
    truth = {shape.name: shape for _, shape in free_plate_modes()}
    points = np.random.default_rng(1).uniform(-68.0, 68.0, (200, 2))
    expected = np.stack([truth[name].evaluate(points) for name in ("11x0", "0x11")], axis=-1)
    np.testing.assert_allclose(shapes.evaluate(points), expected, atol=2e-3)
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    table = json.loads(files["json"].read_text())
    assert table["pairs"][table["taken"] - 1]["modes"] == ["11x0", "0x11"]
    assert len(table["stamps"]) == 121


def test_the_picture_has_labels_and_a_scale_of_each_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Any] = []
    monkeypatch.setattr(plotting, "save", lambda figure, *_, **__: figures.append(figure))
    assert main(["plate", "--plot", str(tmp_path / "plate.png")]) == 0
    *maps, shapes, both = figures[0].axes
    assert [axis.get_xlabel() for axis in maps[-3:]] == ["x, mm"] * 3
    assert [axis.get_ylabel() for axis in maps[::3]] == ["y, mm"] * (len(maps) // 3)
    assert "its largest value is 1" in shapes.get_xlabel()
    assert "sum of both" in both.get_xlabel()


def test_another_pair_of_the_table_may_be_taken_and_json_written_to_the_output(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["plate", "--pair", "2", "--json", "-"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["taken"] == 2
    assert "* 2 9x6 + 6x9" in output.err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--size", "big"], "--size is 'big'"),
        (["--material", "wood"], "there is no material 'wood'"),
        (["--thickness", "0"], "--thickness: 0 is out of bounds"),
        (["--thickness", "1e-300"], "--thickness: 1e-300 is out of bounds, it must be 0.01 .. 100"),
        (["--near", "nan"], "--near: nan is out of bounds"),
        (["--near", "2900000"], "waves too short"),
        (["--splitting", "-1"], "--splitting: -1 is out"),
        (["--near", "500"], "No pair"),
        (["--pair", "99"], "--pair is 99"),
        (["--stamp", "nan"], "--stamp: nan is out"),
        (["--amplitude", "-1"], "--amplitude: -1 is out"),
        (["--out", "/nonexistent/plate.npz"], "/nonexistent/plate.npz"),
        (["--json", "/nonexistent/plate.json"], "/nonexistent/plate.json"),
        (["--plot", "/nonexistent/plate.png"], "/nonexistent/plate.png"),
    ],
)
def test_a_plate_that_cannot_be_is_one_sentence_and_exit_code_2(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plate", *arguments]) == 2
    complaint = capsys.readouterr().err
    assert sentence in complaint
    assert complaint.count("\n") == 1
