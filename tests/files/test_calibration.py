"""The calibration file: round trip, and errors in one sentence."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from hapticd.board_values import BoardCalibration, ModeCalibration
from hapticd.errors import ConfigError, HapticdError
from hapticd.files import calibration

X = ModeCalibration(0, 29195.02, 498.7, 5.31, math.radians(-1.25))
Y = ModeCalibration(1, 29215.1, 502.3, 5.28, math.radians(175.5))
MIXED = ModeCalibration(
    1, 29215.1, 502.3, 5.28, 0.0, drive=(1.0, -0.5), sense=(0.7 + 0j, -0.7 + 0.01j), feedthrough_um_per_v=(0.001j, 0j)
)
SOUND = "[[mode]]\nmode = 0\nfrequency_hz = 29195\nq_factor = 500\ngain_um_per_v_s = 5\nloop_phase_deg = 0\n"


def test_what_is_saved_is_loaded_again_in_the_order_of_the_modes(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    calibration.save(path, BoardCalibration((Y, X)))
    first, second = calibration.load(path, 2).modes
    for found, saved in ((first, X), (second, Y)):
        assert found.mode == saved.mode
        assert found.frequency_hz == pytest.approx(saved.frequency_hz, abs=1e-3)
        assert found.q_factor == pytest.approx(saved.q_factor, abs=0.01)
        assert found.gain_um_per_v_s == pytest.approx(saved.gain_um_per_v_s, rel=1e-4)
        assert found.loop_phase_rad == pytest.approx(saved.loop_phase_rad, abs=1e-4)


def test_a_drive_is_loaded_again_and_may_be_missing(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    calibration.save(path, BoardCalibration((X, Y), 29207.25))
    found = calibration.load(path, 2)
    assert (len(found.modes), found.drive_hz) == (2, 29207.25)
    calibration.save(path, BoardCalibration((X, Y)))
    assert calibration.load(path, 2).drive_hz is None


@pytest.mark.parametrize("value", ["true", "0", "'29205'", "nan"])
def test_a_senseless_drive_is_refused_in_one_sentence(tmp_path: Path, value: str) -> None:
    path = tmp_path / "plate.toml"
    calibration.save(path, BoardCalibration((X,)))
    path.write_text(f"drive_hz = {value}\n" + path.read_text())
    with pytest.raises(ConfigError, match=r"drive_hz: .* is out of bounds"):
        calibration.load(path, 2)


def test_the_wiring_is_loaded_again_and_may_be_missing(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    calibration.save(path, BoardCalibration((X, MIXED)))
    first, second = calibration.load(path, 2).modes
    assert (first.drive, first.sense, first.feedthrough_um_per_v) == ((), (), ())
    assert (second.drive, second.sense, second.feedthrough_um_per_v) == (
        MIXED.drive,
        MIXED.sense,
        MIXED.feedthrough_um_per_v,
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("mode = [", "is not valid TOML"),
        ("", r"must hold \[\[mode\]\] tables"),
        ("[device]\nport = 1\n" + SOUND, r"must hold \[\[mode\]\] tables, drive_hz and nothing else"),
        ("[mode]\nmode = 0", r"must hold \[\[mode\]\] tables"),
        ("mode = [3]", r"\[\[mode\]\] 1: must be a table"),
        (SOUND + "damping = 1", r"\[\[mode\]\] 1: unknown key damping"),
        (SOUND.replace("q_factor = 500\n", ""), r"\[\[mode\]\] 1: q_factor is missing"),
        (SOUND.replace("mode = 0", "mode = 2"), "mode 2 is not one of the plate's 2"),
        (SOUND.replace("mode = 0", "mode = true"), r"mode: must be a whole number.*not True"),
        (SOUND + SOUND, r"\[\[mode\]\] 2: mode 0 is listed twice"),
        (SOUND.replace("29195", '"29195"'), "frequency_hz: '29195' is out of bounds"),
        (SOUND.replace("= 5\n", "= nan\n"), "gain_um_per_v_s: nan is out of bounds"),
        (SOUND + "drive = 1", "drive: 1 is not a list of 2: give a number for each wire"),
        (SOUND + "drive = [1.0, true]", "drive: True is out of place: give a number"),
        (SOUND + "drive = [1.0, 20.0]", "drive: 20.0 is out of bounds"),
        (SOUND + "sense = [[1, 0], [1]]", r"sense: \[1\] is out of place: give \[real, imaginary\]"),
        (SOUND + "sense = [[1, 0], [nan, 1]]", "is out of bounds: it must be 0 .. 100"),
        (SOUND.replace("500", "2"), "q_factor: 2 does not describe a resonance"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=sentence) as refused:
        calibration.load(path, 2)
    assert str(refused.value).startswith(f"{path}: ")
    assert str(refused.value).count("\n") == 0


def test_a_missing_file_and_a_place_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        calibration.load(tmp_path / "none.toml", 2)
    with pytest.raises(HapticdError, match="cannot be written"):
        calibration.save(tmp_path / "no" / "folder.toml", BoardCalibration((X,)))
