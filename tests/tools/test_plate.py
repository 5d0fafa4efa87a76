"""`hapticd plate`: a search, its verdict and its files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.design import felt_search
from hapticd.sim.plate.glasses import find_glass
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.tools import plate

SMALL = ["plate", "--felt", "--jobs", "1", "--size", "100x100", "--thickness", "2", "--modes", "2"]
SMALL += ["--drive", "28500..29700"]
KIT = ["--place", "8x8x0.3"]


@pytest.fixture
def short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, less in {"JUDGE_PLACES": 40, "SEARCH_PLACES": 10, "MORE_ROUNDS": 3, "ROUNDS": 1}.items():
        monkeypatch.setattr(felt_search, name, less)
    monkeypatch.setattr(plate, "FARTHEST_HZ", 300.0)


@pytest.mark.usefixtures("short_search")
def test_a_plate_is_searched_and_its_files_fit_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {name: tmp_path / f"plate.{name}" for name in ("npz", "png", "json", "toml")}
    options = zip(("--out", "--plot", "--json", "--glass"), map(str, files.values()), strict=True)
    assert main([*SMALL, *KIT, "--tolerances", "1", *(word for option in options for word in option)]) == 0
    printed = capsys.readouterr().out
    found = json.loads(files["json"].read_text())
    best = found["designs"][0]
    assert len(best["patches"]) == len(best["modes"]) == len(best["moving_ma"]) == 2
    assert [len(one["felt_frac"]) for one in found["tolerances"]] == [1] * min(3, len(found["designs"]))
    assert found["targets_um"] == [1.0, 0.0]
    assert "not simulated, as simulated strokes need a plate of 116 x 116 mm or more" in printed
    assert "% of places at rest; of 1 copies nine in ten " in printed
    assert [one["unit"].split()[0] for one in found["bounds"]] == ["MPa", "Hz", "mA", "degrees", "dB"]
    assert [load["volts_v"] for load in best["loads"]] == [90.0, 90.0]  # 300 V/mm
    assert "1.98  3.31" in printed  # nF of 8 x 8 x 0.3 mm, glued and free
    assert "nC peak per um of a mode." in printed
    assert files["toml"].read_text().splitlines()[0] == f"# {printed.splitlines()[-1]}"
    truth = GroundTruth(PlateSettings.of(str(files["toml"])))
    assert truth.w_limit_um == pytest.approx(best["limits_um"], rel=0.05)  # by the first mode's decay
    assert truth.nominal_detuning_rad_s / (2.0 * np.pi) + best["drive_hz"] == pytest.approx(best["frequency_hz"])
    points_mm = np.random.default_rng(1).uniform(-45.0, 45.0, (50, 2))
    np.testing.assert_allclose(
        ModeShapes.load(files["npz"]).evaluate(points_mm), truth.shapes(points_mm)[:, :2], atol=5e-3
    )
    assert [list(patch) for patch in find_glass(str(files["toml"])).patches] == best["patches"]
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    sensors = found["placement"]["sensors"]
    assert np.array(sensors["coupling"]).shape == (2, 2)
    away_mm = np.abs(np.array(sensors["places_mm"])[:, None] - np.array(best["patches"])[:, :2])
    assert np.all(away_mm.max(axis=2) >= (3.0 + 8.0) / 2.0 - 1e-9)  # no sensor is over a patch
    assert [line.split()[:2] for line in printed.splitlines() if line.startswith(("sensor", "stamp"))] == [
        *(["sensor", str(index)] for index in (1, 2)),
        *(["stamp", str(index)] for index in (1, 2, 3, 4)),
    ]


@pytest.mark.usefixtures("short_search")
def test_a_plate_is_judged_with_the_patches_that_it_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    patches, made = ["--patch=-46,0,8x8x0.3", "--patch=0,46,8x8x0.3"], tmp_path / "made.json"
    assert main([*SMALL, *patches, "--json", str(made)]) == 0
    (design,) = json.loads(made.read_text())["designs"]
    assert design["patches"] == [[-46.0, 0.0, 8.0, 8.0, 0.3], [0.0, 46.0, 8.0, 8.0, 0.3]]
    assert 0.0 <= design["felt_frac"] <= design["within_volts_frac"] <= 1.0
    assert "with 2 patches, driven at" in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.usefixtures("short_search")
def test_motion_is_what_simulate_gives_on_the_plates_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {name: tmp_path / f"{name}.json" for name in ("design", "motion")}
    glass = tmp_path / "glass.toml"
    arguments = ["--size", "200x200", "--thickness", "2", "--modes", "4", "--drive", "32600..32800"]
    outputs = ["--glass", str(glass), "--json", str(files["design"])]
    assert main(["plate", "--felt", *arguments, "--place", "20x10x0.3", *outputs]) == 0
    printed = capsys.readouterr().out
    assert "friction as asked, in motion: " in printed
    played_on = ["--motion", "smooth", "--plate", str(glass)]
    assert main(["simulate", "strokes", "--alone", *played_on, "--json", str(files["motion"])]) == 0
    found, played = (json.loads(file.read_text()) for file in files.values())
    assert found["motion"]["felt_frac"] == pytest.approx(played["hapticd"]["felt_frac"], abs=0.01)  # reach is rounded
    assert found["motion"]["felt_frac"] > 0.0
    assert 0.5 < found["motion"]["within_volts_frac"] <= 1.0
    contrast = found["motion"]["slip_um"] / found["motion"]["still_um"]
    assert contrast == pytest.approx(played["hapticd"]["contrast"], rel=0.01)
    assert f"contrast, in motion: {contrast:.1f} (simulated" in printed


def test_targets_are_frictions_or_amplitudes() -> None:
    usual = DEFAULT_FRICTION_CURVE
    assert plate._targets_um("1um,0um", usual) == (1.0, 0.0)
    assert plate._targets_um("0,1", usual) == (2.0, 0.0)
    slippery_um, half_um, sticky_um = plate._targets_um("0.2,0.5um,1", usual)
    assert (half_um, sticky_um) == (0.5, 0.0)
    assert 0.5 < slippery_um < 2.0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--felt", "2,0"], "--felt: 2 is out of bounds, it must be 0 .. 1: write frictions"),
        (["--felt", "0um,1"], "--felt: '0um,1' must be of 2 to 5 fingers, one of which slips."),
        (["--felt", "--modes", "9"], "--modes: 9 is out of bounds, it must be 2 .. 8"),
        (["--felt", "--modes", "2.5"], "--modes: '2.5' is not a whole number"),
        (["--felt", "--size", "240..150"], "--size: '240..150' is no range: write the lower end first"),
        (["--felt", "--size", "1x2x3"], "--size: '1x2x3' has more than two edges"),
        (["--felt", "--size", "10..1000"], "15150 plates are too many"),
        (["--felt", "--thickness", "x"], "--thickness: 'x' is not a number"),
        (["--thickness", "1e-300"], "--thickness: 1e-300 is out of bounds, it must be 0.01 .. 100"),
        (["--felt", "--drive", "nan"], "--drive: nan is out of bounds"),
        (["--felt", "--material", "glass/wood"], "there is no material 'wood'"),
        (["--felt", "--patch", "1,2,3"], "--patch: '1,2,3' is no patch: write position and dimensions in mm"),
        (["--felt", "--patch", "0,0,8x8x0.3", "--place", "8x8x0.3"], "--place: --patch says where the patches are"),
        ([*SMALL[1:], "--patch=45,45,8x8x0.3"], "1 patches drive 2 modes; glue one for each."),
        ([*SMALL[1:], "--patch", "48,0,8x8x0.3"], "the patch at 48,0 mm reaches over the plate's edge"),
        (["--felt", "--place", "8x8"], "--place: '8x8': write sizes of patches in mm"),
        ([*SMALL[1:], "--modes", "8"], "No plate with its patches has 8 modes within 180 Hz of a drive"),
        ([*SMALL[1:], *KIT, "--place", "60x60x0.3"], "patches of 60x60 mm are too large for the plate's edges."),
    ],
)
def test_what_cannot_be_searched_is_one_sentence(
    arguments: list[str], sentence: str, refused: Callable[..., str]
) -> None:
    assert sentence in refused("plate", *arguments)
