"""`hapticd firmware selftest`: what has moved since the calibration, in two seconds."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual_board import BoardLink

from hapticd.board_values import BoardCalibration, ModeCalibration
from hapticd.errors import DeviceError, UsageError
from hapticd.files import calibration
from hapticd.sim.board.board import Board, BoardConfig

TypeIn = Callable[..., str]
OWN = BoardConfig()


Tested = Callable[..., str]
SWAPPED = np.array([[0.0, 1.0], [1.0, 0.0]])
DEAD = {"sensor": np.diag([1.0, 0.0]), "noise_um": 0.0005}


@pytest.fixture
def tested(type_in: TypeIn) -> Tested:
    """Returns what `selftest` with these arguments says of a plate that differs so from the board's models."""

    def run(*arguments: str, **changes: Any) -> str:
        link = BoardLink()
        link.board = Board(replace(link.board.model, **changes), config=OWN, boot_id=7)
        said = type_in(link, "selftest", *arguments)
        assert link.board.t_us < 2_200_000  # with the greeting
        assert link.peak_v <= 15.0001
        assert not link.voltage_v.any()
        return said

    return run


def test_a_plate_as_calibrated_has_not_moved(tested: Tested) -> None:
    assert "Nothing has moved" in tested()
    assert "Nothing has moved" in tested(noise_um=0.001)


@pytest.mark.parametrize(("modes", "most_s"), [(3, 2.2), (4, 2.2), (6, 3.9)])
def test_a_plate_of_more_modes_is_swept_as_wide_as_they_lie(modes: int, most_s: float, type_in: TypeIn) -> None:
    offsets_hz = np.array((12.0, -18.0, -91.0, -70.0, 82.0, 169.0))[:modes]
    config = replace(
        OWN,
        w_limit_um=(4.0,) * modes,
        decay_1_s=(183.0,) * modes,
        detuning_rad_s=tuple((2 * np.pi * offsets_hz).tolist()),
        gain_um_per_v_s=(5.0,) * modes,
        loop_phase_rad=(0.0,) * modes,
    )
    link = BoardLink(config=config)
    assert "Nothing has moved" in type_in(link, "selftest")
    assert link.board.t_us < 1e6 * most_s


DRIFT = np.array(OWN.detuning_rad_s) + 2 * np.pi * 30


@pytest.mark.parametrize(
    ("changes", "moved", "unsafe"),
    [
        ({"detuning_rad_s": DRIFT}, ["Mode 0 has moved by +30.", "Mode 1 has"], ""),
        ({"decay_1_s": np.array(OWN.decay_1_s) * [1.0, 2.0]}, ["Mode 1 has a quality of 250, not 500"], ""),
        ({"sensor": np.diag([0.5, 1.0])}, ["Mode 0 has 0.50 times its gain"], ""),
        ({"through_um_per_v": 0.005 * np.eye(2)}, ["Mode 0: the feedthrough of amplifier 0 is 0.005"], ""),
        ({"sensor": np.array([[1.0, 0.3], [0.0, 1.0]])}, ["the weight of sensor"], ""),
        ({"loop_phase_rad": (0.0, 0.5)}, ["Mode 1 has turned its loop phase by +29 degrees"], ""),
        ({"loop_phase_rad": (0.0, 1.0)}, ["Mode 1 has turned"], r"The loop of mode 1 is \+57 degrees off"),
        ({"sensor": np.diag([2.5, 1.0])}, ["Mode 0 has 2.50"], "The loop of mode 0 has 2.50 times its gain"),
        ({"sensor": np.diag([0.3, 1.0])}, ["Mode 0 has 0.30"], "The loop of mode 0 has 0.30 times its gain"),
        ({"sensor": SWAPPED}, ["are swapped"], "Amplifiers 0 and 1, or their sensors, are swapped"),
        ({"sensor": np.diag([-1.0, 1.0])}, ["0 is inverted"], "Amplifier 0 or sensor 0 is inverted"),
    ],
    ids=str,
)
def test_it_says_what_has_moved_and_what_the_loop_cannot_bear(
    changes: dict[str, Any], moved: list[str], unsafe: str, tested: Tested
) -> None:
    found = json.loads(tested("--json", **changes))
    assert all(any(sentence in line for line in found["moved"]) for sentence in moved)
    assert bool(found["unsafe"]) is bool(unsafe)
    assert re.search(unsafe, "\n".join(found["unsafe"]))
    assert set(found["moved"] + found["unsafe"]) == set(tested(**changes).splitlines()[2:])


def test_wires_that_a_calibration_knows_are_safe_however_they_lie(tested: Tested, tmp_path: Path) -> None:
    found = json.loads(tested("--json", sensor=SWAPPED))
    assert found["unsafe"] != []
    saved = tmp_path / "plate.toml"
    calibration.save(saved, BoardCalibration(tuple(mode_of(one) for one in found["modes"])))
    assert json.loads(tested("--calibration", str(saved), "--json", sensor=SWAPPED))["unsafe"] == []


def mode_of(found: dict[str, Any]) -> ModeCalibration:
    sense, feedthrough = ([complex(*pair) for pair in found[name]] for name in ("sense", "feedthrough_um_per_v"))
    return ModeCalibration(
        **{**found, "drive": tuple(found["drive"]), "sense": tuple(sense), "feedthrough_um_per_v": tuple(feedthrough)}
    )


def test_a_dead_sensor_is_one_sentence_and_unsafe_in_the_document_too(
    tested: Tested, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in ((), ("--json",)):
        with pytest.raises(DeviceError, match="may be dead"):
            tested(*arguments, **DEAD)
    (sentence,) = json.loads(capsys.readouterr().out)["unsafe"]
    assert "may be dead" in sentence


def test_it_compares_with_a_calibration_file(link: BoardLink, type_in: TypeIn, tmp_path: Path) -> None:
    saved = tmp_path / "plate.toml"
    modes = tuple(
        ModeCalibration(mode, 29195.0 + 20.0 * mode, 500.0, OWN.gain_um_per_v_s[mode], 0.0) for mode in range(2)
    )
    for count, sentence in ((0, "cannot"), (1, "lacks a mode")):
        with pytest.raises(UsageError, match=sentence):
            type_in(BoardLink(), "selftest", "--calibration", str(saved))
        calibration.save(saved, BoardCalibration(modes[: count + 1]))
    found = json.loads(type_in(link, "selftest", "--calibration", str(saved), "--json"))
    assert found["moved"] == []
    assert [mode["q_factor"] for mode in found["modes"]] == pytest.approx([500.0, 500.0], rel=0.02)
