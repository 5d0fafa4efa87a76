"""The doctor looks at what is there, and each finding that is not a pass says what mends it."""

from __future__ import annotations

import fcntl
import socket
from pathlib import Path

import pytest

from hapticd import doctor
from hapticd.sim.plate import PlateTruth


def examined(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    path = tmp_path / "hapticd.toml"
    path.write_text(text, encoding="utf-8")
    return doctor.examine(path), capsys.readouterr().out


def test_the_simulated_plate_is_in_good_health(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, report = examined(f'[client]\nruntime_dir = "{tmp_path}"\n', tmp_path, capsys)
    assert code == 0
    assert "FAIL" not in report
    assert f"warn  daemon: none serves {tmp_path}" in report


def test_a_bad_configuration_is_all_it_looks_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, report = examined("[limits]\nw_limit = 3\n", tmp_path, capsys)
    assert code == 1
    assert "did you mean w_limit_um?" in report
    assert "board:" not in report


def test_a_missing_board_fails_with_its_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    PlateTruth().cartography(1).save(tmp_path / "modes.npz")
    text = f'[device]\nport = "{tmp_path}/none"\n[trackpad]\nsource = "replay"\nreplay_file = "modes.npz"\n'
    code, report = examined(text + '[plate]\nmodes_file = "modes.npz"\n', tmp_path, capsys)
    assert code == 1
    assert f"FAIL  board: there is no {tmp_path}/none\n      -> plug the board in" in report


def test_a_file_that_holds_no_modes_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "modes.csv").write_text("nothing", encoding="utf-8")
    code, report = examined('[plate]\nmodes_file = "modes.csv"\n', tmp_path, capsys)
    assert code == 1
    assert "FAIL  mode shapes:" in report


def test_a_daemon_that_died_is_not_taken_for_a_living_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = f'[client]\nruntime_dir = "{tmp_path}"\n'
    with socket.socket(socket.AF_UNIX) as left_behind, (tmp_path / "lock").open("wb") as lock:
        left_behind.bind(str(tmp_path / "control"))
        assert "warn  daemon: none serves" in examined(text, tmp_path, capsys)[1]
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert f"pass  daemon: endpoints in {tmp_path}" in examined(text, tmp_path, capsys)[1]
