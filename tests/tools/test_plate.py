"""`hapticd plate`: table, files, and refused arguments."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.design import free_plate_modes


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


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--size", "big"], "--size is 'big'"),
        (["--material", "wood"], "there is no material 'wood'"),
        (["--thickness", "0"], "--thickness: 0 is out of bounds"),
        (["--thickness", "1e-300"], "--thickness: 1e-300 is out of bounds, it must be 0.01 .. 100"),
        (["--near", "nan"], "--near: nan is out of bounds"),
        (["--near", "2900000"], "waves too short"),
        (["--near", "500"], "No pair"),
        (["--pair", "99"], "--pair is 99"),
        (["--stamp", "nan"], "--stamp: nan is out"),
        (["--place", "10x10x0.3"], "--place: belongs to --felt: add it"),
        (["--modes", "4"], "--modes: belongs to --felt: add it"),
    ],
)
def test_a_plate_that_cannot_be_is_one_sentence_and_exit_code_2(
    arguments: list[str], sentence: str, refused: Callable[..., str]
) -> None:
    assert sentence in refused("plate", *arguments)
