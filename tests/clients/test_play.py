"""`hapticd play`, and what it plays, on the machine in lock-step: each file is felt at its time, where it lies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fake_daemon import FakeDaemon
from PIL import Image

from hapticd.__main__ import main
from hapticd.errors import ExitCode


def pattern(folder: Path, *times_s: float) -> Path:
    """An AHAP file with clicks."""
    events = [{"Event": {"Time": t_s, "EventType": "HapticTransient"}} for t_s in times_s]
    path = folder / "clicks.ahap"
    path.write_text(json.dumps({"Version": 1.0, "Pattern": events}), encoding="utf-8")
    return path


# --- the command ------------------------------------------------------------------------------------------------


def test_the_command_plays_a_file_prints_what_is_dropped_and_ends(
    daemon: FakeDaemon, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.fingers = {1: (0.0, 0.0)}
    path = pattern(tmp_path, 0.0)
    text = path.read_text(encoding="utf-8").replace("]", ', {"Event": {"EventType": "AudioCustom"}}]')
    path.write_text(text, encoding="utf-8")
    assert main(["play", str(path), "--endpoint", str(daemon.directory), "--seconds", "0.2"]) == ExitCode.DONE
    printed = capsys.readouterr()
    assert printed.out == "clicks.ahap: 0.02 s of effects\nno finger touched the plate\n"
    assert printed.err == "not felt as it is: events AudioCustom.\n"


@pytest.mark.parametrize(
    ("width_mm", "sentence"),
    [
        ("900", "900 x 450 mm is larger than the plate of 137.5 x 137.5 mm: give 0.1 .. 137.5."),
        ("0.05", "--width-mm: 0.05 is out of bounds, it must be 0.1 .. 1000."),
    ],
)
def test_a_picture_wider_than_the_plate_is_refused_before_it_is_laid(
    width_mm: str, sentence: str, daemon: FakeDaemon, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.fromarray(np.full((8, 16), 200, dtype=np.uint8)).save(tmp_path / "wide.png")
    call = ["play", str(tmp_path / "wide.png"), "--endpoint", str(daemon.directory), "--seconds", "0.1"]
    assert main([*call, "--width-mm", width_mm]) == ExitCode.WRONG_CALL
    assert capsys.readouterr().err.endswith(f"{sentence}\n")
    assert not daemon.scene.surfaces.layers
    assert main([*call, "--width-mm", "137.5"]) == ExitCode.DONE


@pytest.mark.long
def test_a_file_is_played_on_the_simulated_plate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = pattern(tmp_path, *[0.05 * index for index in range(20)])
    assert main(["play", str(path), "--sim"]) == ExitCode.DONE
    assert "um for finger 1" in capsys.readouterr().out
