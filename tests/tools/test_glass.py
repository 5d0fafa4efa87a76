"""`--plate` and `--modes`, on every command that starts a simulated plate."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.__main__ import parser as cli_parser
from hapticd.config.sections import SimConfig
from hapticd.errors import DeviceError, SimulationError
from hapticd.formats.toml_file import parse
from hapticd.sim.plate.glasses import driven_modes, find_glass, most_driven
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.tools import glass, run
from hapticd.tools.view import program as view_program


def parsed(*words: str) -> argparse.Namespace:
    return cli_parser(words[0]).parse_args(words)


@pytest.mark.parametrize(
    "command",
    [
        ("run", "--sim"),
        ("view", "--sim"),
        ("doctor", "latency", "--sim"),
        ("play", "sound.wav", "--sim"),
        ("simulate", "strokes"),
    ],
)
def test_every_command_with_a_simulated_plate_takes_its_name_and_number_of_modes(command: tuple[str, ...]) -> None:
    assert glass.chosen(parsed(*command)) == SimConfig()
    assert glass.chosen(parsed(*command, "--plate", "fingertip")) == SimConfig(plate="fingertip", modes=4)
    assert glass.chosen(parsed(*command, "--modes", "3")) == SimConfig(modes=3)


def test_a_newcomer_is_shown_the_plate_for_whole_fingertips(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[SimConfig] = []

    class Service:
        def __init__(self, table: str) -> None:
            started.append(SimConfig(**parse(table, "table")))
            raise DeviceError("Enough.")

    monkeypatch.setattr(view_program.signal, "signal", lambda *_: None)  # its handler would stay
    monkeypatch.setattr(view_program, "DaemonProcess", Service)
    for options in ((), ("--modes", "3"), ("--plate", "reference")):
        assert main(["view", "--sim", "--port", "0", *options]) == 1
    assert started == [
        SimConfig(scenario="hands", plate="fingertip"),
        SimConfig(scenario="hands", plate="fingertip", modes=3),
        SimConfig(scenario="hands", plate="reference", modes=2),
    ]


def test_the_plate_becomes_part_of_the_configuration_that_is_served_and_checked() -> None:
    options = parsed("run", "--sim", "--plate", "fingertip", "--modes", "3")
    assert run.configuration(options).sim == SimConfig(plate="fingertip", modes=3)
    assert run._check_command(options)[-5:] == ["--sim", "--plate", "fingertip", "--modes", "3"]


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("run --modes 5", "--modes: 5 modes cannot be driven on the reference plate: give 2 to 4."),
        ("view --plate fingertip", "--plate, --copy, --modes and --wiring name a simulated plate: give --sim as well."),
        ("view --sim --modes 9", "--modes: 9 modes cannot be driven on the fingertip plate: give 2 to 4."),
        ("view --sim --wiring paper", "this plate drives 4: choose the reference plate, or 2 modes."),
        ("simulate strokes --copy 1", "--plate: this plate has no copies, as it has no patches"),
        ("simulate strokes --plate steel", "there is no plate 'steel': give reference, fingertip, wide, or a file;"),
        ("simulate strokes --plate none.toml", "none.toml: cannot be read (No such file or directory)"),
        ("play sound.wav --plate fingertip", "give --sim as well."),
    ],
)
def test_a_plate_that_cannot_be_simulated_is_refused(command: str, sentence: str, refused: Callable[..., str]) -> None:
    assert sentence in refused(*command.split())


PLATE = {
    "size_mm": "[160.0, 160.0]",
    "thickness_mm": "3.0",
    "drive_hz": "30600.0",
    "driven": "2",
    "reach_um": "4.23",
    "modes": '["11x0", "0x11", "9x6", "6x9"]',
    "material": '"glass"',
}


def written(path: Path, **changes: str | None) -> str:
    table = PLATE | changes
    path.write_text("".join(f"{key} = {value}\n" for key, value in table.items() if value), encoding="utf-8")
    return str(path)


def test_a_plate_may_be_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "mine.toml")
    monkeypatch.chdir(tmp_path)
    assert glass.chosen(parsed("run", "--sim", "--plate", "mine.toml")) == SimConfig(plate=path, modes=2)
    found = find_glass(path)
    assert (found.size_mm, found.drive_hz, found.driven) == ((160.0, 160.0), 30600.0, 2)


@pytest.mark.long
def test_a_copy_is_driven_as_its_scan_chooses_and_its_map_has_what_patches_push() -> None:
    sim = glass.chosen(parsed("simulate", "strokes", "--plate", "fingertip", "--copy", "17"))
    assert sim == SimConfig(plate="fingertip#17", modes=4)
    found, drawn = find_glass(sim.plate), find_glass("fingertip")
    assert found.size_mm != drawn.size_mm
    assert 0.0 < abs(found.drive_hz / drawn.drive_hz - 1.0) < 0.1
    plate = GroundTruth(PlateSettings.of(sim.plate))
    assert np.abs(plate.frequency_hz[:4] - found.drive_hz).max() <= 180.0
    assert max(plate.w_limit_um) <= 6.0 * 1.001
    volts = np.linalg.solve(plate.gain_um_per_v_s[:4], (1j * plate.detuning_rad_s - plate.decay_1_s)[:4] * np.eye(4))
    others_um = plate.gain_um_per_v_s[4:] @ volts / (1j * plate.detuning_rad_s - plate.decay_1_s)[4:, None]
    points_mm = np.random.default_rng(1).uniform(-80.0, 80.0, (50, 2))
    phi = plate.shapes(points_mm)
    np.testing.assert_allclose(
        plate.true_mode_map().evaluate(points_mm), phi[:, :4] + phi[:, 4:] @ others_um.real, atol=1e-3
    )
    assert np.abs(others_um).max() > 0.01


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"material": None}, "`material`"),
        ({"size_mm": "[160.0]"}, "size_mm"),
        ({"thickness_mm": "true"}, "thickness_mm"),
        ({"moon": "1"}, "`moon`"),
        ({"reach_um": "[4.0, 5.0, 6.0]"}, "reach_um: needs one number, or one for each of 2 driven modes."),
        ({"reach_um": "[4.0, 0.0]"}, ">= 0.01 - at `$.reach_um[1]`"),
        ({"drive_hz": "nan"}, ">= 2000.0 - at `$.drive_hz`"),
        ({"driven": "2.5"}, "driven"),
        ({"driven": "3"}, "modes: needs 5 or more, each once; the driven first."),
        ({"modes": "[1, 2, 3, 4]"}, "modes[0]"),
        ({"modes": '["11x0", "11x0", "9x6", "6x9"]'}, "modes: needs 4 or more, each once; the driven first."),
        ({"material": '"butter"'}, "there is no material 'butter'; give one of"),
        ({"material": '"0,0,0"'}, "material: '0,0,0' is no solid's GPa,Poisson,kg/m3."),
        ({"material": '"70,2,2500"'}, "mine.toml plate: poisson is 2.0;"),
        ({"size_mm": "[1000.0, 10.0]"}, "mine.toml plate: band_hz reaches waves too short for this plate size;"),
        ({"patches": "[[0.0, 0.0, 10.0, 10.0]]"}, "length 5, got 4 - at `$.patches[0]`"),
        ({"patches": "3"}, "patches"),
        ({"patches": "[[78.0, 0.0, 10.0, 10.0, 0.3]]"}, "the patch at 78,0 mm reaches over the plate's edge."),
        ({"modes": '["11x0", "0x11", "9x6", "1x1"]'}, "mine.toml plate has no mode '1x1' near its drive."),
    ],
)
def test_a_file_that_describes_no_plate_is_refused_in_one_sentence(
    changes: dict[str, str | None], sentence: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "mine.toml", **changes)
    with pytest.raises(SimulationError) as caught:
        GroundTruth(PlateSettings.of(path))
    assert sentence in str(caught.value)


def test_a_plate_has_the_reach_of_each_mode_and_the_modes_that_its_patches_make(tmp_path: Path) -> None:
    patch = "[[0.0, 75.0, 20.0, 10.0, 0.5]]"
    bare = GroundTruth(PlateSettings.of(written(tmp_path / "bare.toml", reach_um="[8.0, 2.0]")))
    path = written(tmp_path / "glued.toml", reach_um="[8.0, 2.0]", patches=patch)
    glued = GroundTruth(PlateSettings.of(path))
    for plate in (bare, glued):
        stiffness_1_s = np.hypot(plate.nominal_decay_1_s, plate.nominal_detuning_rad_s)
        at_resonance_um = np.array(plate.w_limit_um) * stiffness_1_s / plate.nominal_decay_1_s
        assert at_resonance_um == pytest.approx([8.0, 2.0], rel=1e-3)
        assert plate.nominal_gain_um_per_v_s * 150.0 == pytest.approx(
            at_resonance_um * plate.nominal_decay_1_s, rel=1e-3
        )
    assert np.abs(glued.frequency_hz - bare.frequency_hz).max() > 5.0
    assert most_driven(path) == 2
    with pytest.raises(SimulationError, match="give 2 to 2"):
        driven_modes(path, 3)
