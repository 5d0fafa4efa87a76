"""`hapticd plate map` by its command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hapticd.__main__ import main
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.public import solve
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

PAIR = GroundTruth(PlateSettings()).measured_mode_map(1)


def test_the_table_has_both_maps_side_by_side(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plate", "map", "--finger", "-30,20", "--cells", "21"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "a plate of 137.5 x 137.5 mm, 2 modes of at most 3.8, 3.8 um"
    assert lines[1] == "(1) the other finger still, while one at -30, 20 mm slips by 1 um"
    assert lines[2] == "(2) the other finger slips by 1 um, while one at -30, 20 mm is still"
    shares = np.array([line.split()[-6:-4] for line in lines[5:8]], float)
    assert (np.diff(shares, axis=0) <= 0.0).all()
    assert (shares > 20.0).all()
    assert (shares < 100.0).all()


def test_the_arrays_are_what_the_solver_gives_on_any_modes(tmp_path: Path) -> None:
    shapes = np.stack([*PAIR.shapes, PAIR.shapes[0].T * PAIR.shapes[1]])
    modes, out = ModeShapes.from_grid(PAIR.x_mm, PAIR.y_mm, shapes), tmp_path / "map.npz"
    modes.save(tmp_path / "three.npz")
    command = ["plate", "map", "--modes", str(tmp_path / "three.npz"), "--limit", "3,4,2"]
    command += ["--finger", "10,-20", "--finger"]
    assert main([*command, "-40,8.5,0", "--target", "1.5", "--still", "--cells", "7", "--out", str(out)]) == 0
    with np.load(out) as arrays:
        assert arrays["still_target_um"].tolist() == [1.5, 0.0, 0.0]
        assert "slip_share" not in arrays
        places = [*arrays["still_fingers_mm"], (arrays["still_x_mm"][5], arrays["still_y_mm"][2])]
        solved = solve(modes.evaluate(places), [1.5, 0.0, 0.0], arrays["limit_um"])
        assert arrays["still_achieved_um"][:, 2, 5] == pytest.approx(solved.achieved_um)
        assert arrays["still_share"][2, 5] == pytest.approx(min(solved.achieved_um[0] / 1.5, 1.0))


def test_without_a_finger_all_pairs_of_positions_are_mapped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, out = tmp_path / "pairs.png", tmp_path / "pairs.npz"
    assert main(["plate", "map", "--cells", "9", "--plot", str(picture), "--out", str(out)]) == 0
    with np.load(out) as arrays:
        mean, least = arrays["still"].mean(), arrays["slipping"].min()
    lines = capsys.readouterr().out.splitlines()
    assert f"both reach their target on {100 * mean:.1f} % of all pairs of positions" in lines[1]
    assert f"if one slips here, the other can be on this part of the plate: least {100 * least:.0f} % at" in lines[2]
    with Image.open(picture) as drawn:
        assert drawn.width > 900


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--finger", "1,2"] * 16, "--finger: 16 fingers are too many: give at most 15"),
        (["--finger", "1"], "'1' is no position: write X,Y in mm"),
        (["--finger", "a,2"], "'a' is no number"),
        (["--finger", "nan,2"], "nan is out of bounds"),
        (["--finger", "69,2"], "lies off the plate, which reaches from -68.75,-68.75 to 68.75,68.75 mm"),
        (["--finger", "1,2,-1"], "-1 is out of bounds, it must be 0 .. 1000"),
        (["--finger", "1,2,0", "--still"], "no finger slips"),
        (["--finger", "1,2", "--target", "0"], "--target: 0 is out of bounds"),
        (["--finger", "1,2", "--limit", "4,4,4"], "--limit: has 3 limits for 2 modes"),
        (["--finger", "1,2", "--limit", "inf"], "--limit: inf is out of bounds"),
        (["--finger", "1,2", "--cells", "402"], "--cells: 402 is out of bounds"),
        (["--still"], "give a --finger, such as -30,20"),
        (["--cells", "102"], "--cells: without --finger it must be 2 .. 101, not 102"),
        (["--finger", "1,2", "--modes", "there-is-none.npz"], "there-is-none.npz: cannot be read"),
    ],
)
def test_invalid_arguments_are_refused_in_a_sentence(
    arguments: list[str], why: str, refused: Callable[..., str]
) -> None:
    complaint = refused("plate", "map", *arguments)
    assert complaint.startswith("hapticd: --")
    assert why in complaint
