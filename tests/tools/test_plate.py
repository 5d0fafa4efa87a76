"""`hapticd plate`: table, files, and refused arguments."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config import loader
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.design import free_plate_modes
from hapticd.design.contact_search import Drive, Plate, search
from hapticd.design.materials import find_material
from hapticd.tools.plate_verdict import Motion, verdict
from hapticd.tools.service import load_modes


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
        (["--splitting", "-1"], "--splitting: -1 is out"),
        (["--near", "500"], "No pair"),
        (["--pair", "99"], "--pair is 99"),
        (["--stamp", "nan"], "--stamp: nan is out"),
        (["--amplitude", "-1"], "--amplitude: -1 is out"),
        (["--place", "10x10x0.3"], "--place: belongs to --contacts and --felt: add one"),
        (["--contacts", "--drive", "29150", "--modes", "2", "--place", "10x10"], "--place: '10x10' is no patch"),
        (["--contacts", "--drive", "29150", "--modes", "2", "--place", "99x99x1"], "--place: patches of 99x99 mm are"),
        (["--modes", "4"], "--modes: belongs to --contacts and --felt: add one"),
        (["--contacts", "--modes", "9"], "--modes: 9 is out of bounds, it must be 2 .. 8"),
        (["--contacts", "--modes", "2.5"], "--modes: '2.5' is not a whole number"),
        (["--contacts", "--size", "240..150"], "--size: '240..150' is no range: write the lower end first"),
        (["--contacts", "--size", "1x2x3"], "--size: '1x2x3' has more than two edges"),
        (["--contacts", "--size", "10..1000"], "5050 plates are too many"),
        (["--contacts", "--size", "30x25"], "has no room for two fingers"),
        (["--contacts", "--thickness", "x"], "--thickness: 'x' is not a number"),
        (["--contacts", "--drive", "nan"], "--drive: nan is out of bounds"),
        (["--contacts", "--material", "glass/wood"], "there is no material 'wood'"),
        (
            ["--contacts", "--size", "60x60", "--drive", "29000"],
            "No plate has 4 modes near a drive of 29000 to 29000 Hz",
        ),
        (["--contacts", "--patch", "1,2,3"], "--patch: '1,2,3' is no patch: write position and dimensions in mm"),
        (["--contacts", "--patch", "68,0,10x10x0.3"], "the patch at 68,0 mm reaches over the plate's edge"),
        (["--contacts", "--config", "plate.toml"], "--config: names the plate's mode file: add --out F.npz"),
    ],
)
def test_a_plate_that_cannot_be_is_one_sentence_and_exit_code_2(
    arguments: list[str], sentence: str, refused: Callable[..., str]
) -> None:
    assert sentence in refused("plate", *arguments)


# --- whole fingertips -------------------------------------------------------------------------------------------

FAR = Drive(farthest_hz=600.0)
FINGERTIP = ["plate", "--contacts", "--size", "200x200", "--thickness", "3", "--drive", "29300..29450"]


def test_a_plate_for_whole_fingertips_is_judged_in_a_sentence_and_its_files_fit_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {name: tmp_path / f"plate.{name}" for name in ("npz", "png", "json", "toml")}
    arguments = ["--out", str(files["npz"]), "--plot", str(files["png"]), "--json", str(files["json"])]
    assert main([*FINGERTIP, *arguments, "--config", str(files["toml"])]) == 0
    verdict = capsys.readouterr().out.splitlines()[-1]
    assert verdict.startswith("200 x 200 x 3 mm of glass, driven at 29375 Hz with 4 modes (13x1-1x13, 10x8-8x10, 13x0")
    assert verdict.endswith(": enough for whole fingertips.")
    assert f"# {verdict}" == files["toml"].read_text().splitlines()[0]
    (design,) = json.loads(files["json"].read_text())["designs"]
    assert design["modes"] == ["13x1-1x13", "10x8-8x10", "13x0", "0x13"]
    assert design["contrast"] > 12.0
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    config = loader.load(files["toml"])
    assert config.plate.size_mm == (200.0, 200.0)
    assert config.limits.w_limit_um == pytest.approx(design["limits_um"], abs=1e-3)
    shapes = load_modes(config)
    truth = {shape.name: shape for _, shape in free_plate_modes((200.0, 200.0), 3.0)}
    points = np.random.default_rng(1).uniform(-95.0, 95.0, (50, 2))
    expected = np.stack([truth[name].evaluate(points) for name in design["modes"]], axis=-1)
    np.testing.assert_allclose(shapes.evaluate(points), expected, atol=2e-3)


def test_ranges_are_searched_and_sorted_and_random_plates_are_judged(capsys: pytest.CaptureFixture[str]) -> None:
    ranges = ["--size", "180..190", "--thickness", "2.5..3", "--modes", "3..4", "--drive", "32400..32600"]
    still = ["--radius", "5.1"]  # of which no motion is simulated
    assert main(["plate", "--contacts", *ranges, *still, "--tolerances", "1", "--json", "-"]) == 0
    output = capsys.readouterr()
    found = json.loads(output.out)
    scores = [design["score"] for design in found["designs"]]
    assert scores == sorted(scores, reverse=True)
    assert {(190, 180), (190, 190)} <= {tuple(design["size_mm"]) for design in found["designs"]}
    assert {len(design["modes"]) for design in found["designs"]} == {3, 4}
    assert len(found["tolerances"]["contrast_frac"]) == 1
    assert "% of 1 plates reach two thirds" in output.err


@pytest.mark.timeout(300)
def test_a_plate_is_judged_by_what_simulate_gives_fingers_in_motion_on_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its static bound would be enough, with a contrast of 14."""
    files = {name: tmp_path / f"{name}.json" for name in ("design", "motion")}
    plate = ["plate", "--contacts", "--size", "160x160", "--thickness", "3", "--drive", "32370", "--modes", "5"]
    glass = tmp_path / "glass.toml"
    assert main([*plate, "--glass", str(glass), "--json", str(files["design"])]) == 0
    verdict = capsys.readouterr().out.splitlines()[-1]
    simulate = ["simulate", "strokes", "--alone", "--plate", str(glass), "--json", str(files["motion"])]
    assert main([*simulate, "--objective", "felt"]) == 0
    felt = json.loads(files["motion"].read_text())
    assert main([*simulate, "--objective", "contrast", "--force"]) == 0
    found, played = (json.loads(file.read_text()) for file in files.values())
    assert found["designs"][0]["contrast"] > 13.0 > 12.0 > found["motion"]["contrast"]
    assert found["designs"][0]["slip_um"] > 0.75
    assert found["motion"]["contrast"] == pytest.approx(played["hapticd"]["contrast"], rel=1e-12)
    assert found["motion"]["slip_um"] == pytest.approx(played["hapticd"]["contact_slip_um"], rel=1e-12)
    assert found["motion"]["felt_frac"] == pytest.approx(felt["hapticd"]["felt_frac"], rel=1e-12)
    assert f"in {felt['hapticd']['felt_frac']:.0%} of the time, or with `--objective contrast`" in verdict
    assert verdict.endswith(": not enough for whole fingertips (less than a contrast of 12).")


def test_a_design_is_enough_only_by_contrast_and_by_slip() -> None:
    def judged(slip_um: float, still_um: float) -> str:
        return verdict(design, FAR, Motion(slip_um, still_um, 0.3)).rpartition(": ")[2]

    (design,) = search([Plate((100.0, 100.0), 2.0, find_material("glass"))], [2], (29000.0, 29000.0), FAR, pairs=4)
    assert judged(0.67, 0.055) == "enough for whole fingertips."
    assert judged(0.66, 0.05) == "not enough for whole fingertips (less than 0.67 um of slip)."
    lacks = "less than a contrast of 12 and less than 0.67 um of slip"
    assert judged(0.5, 0.05) == f"not enough for whole fingertips ({lacks})."
    assert judged(math.nan, math.nan) == f"not enough for whole fingertips ({lacks})."
    assert judged(0.7, 0.0) == "enough for whole fingertips."


def test_glued_patches_count_in_the_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    patches = ["--patch=-45,-45,8x8x0.3", "--patch=45,45,8x8x0.3"]
    small = ["--size", "100x100", "--modes", "2", "--drive", "28900..29300", "--farthest", "600"]
    assert main(["plate", "--contacts", *small, *patches]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("100 x 100 x 2 mm of glass with 2 patches, driven at")


def test_patches_sensors_and_stamps_are_placed_and_the_plate_is_judged_with_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--size", "100x100", "--modes", "2", "--drive", "29000..29100", "--farthest", "600"]
    outputs = ["--json", str(tmp_path / "plate.json"), "--plot", str(tmp_path / "plate.png")]
    assert main(["plate", "--contacts", *small, "--place", "8x6x0.3", *outputs]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines[-9:-1]] == [
        *(["patch", str(index)] for index in (1, 2)),
        *(["sensor", str(index)] for index in (1, 2)),
        *(["stamp", str(index)] for index in (1, 2, 3, 4)),
    ]
    found = json.loads((tmp_path / "plate.json").read_text())
    assert f"Condition {found['placement']['drive']['condition']:.2f} of the drive matrix" in lines[-1]
    assert found["placement"]["glued"]["frequency_hz"] != found["designs"][0]["frequency_hz"]
    assert np.array(found["placement"]["sense"]["coupling"]).shape == (2, 2)
    assert (tmp_path / "plate.png").stat().st_size > 0
