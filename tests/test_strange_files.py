"""Commands given a pipe, a device, a folder or a loop of links for a file: one sentence at once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.regular_file import open_regular, read_bounded

READERS = [
    ("run", "--check", "--config"),
    ("replay",),
    ("export", "--csv", "tables"),
    ("map", "--modes"),
    ("calibrate", "friction", "--out", "plate", "--readings"),
    ("calibrate", "modes", "--out", "plate", "--scan"),
    ("keys", "allow", "."),
]


@pytest.fixture(autouse=True)
def _strange_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.csv")
    Path("loop.csv").symlink_to("loop.csv")
    Path("folder.csv").mkdir()
    Path("zero.csv").symlink_to("/dev/zero")


@pytest.mark.parametrize("name", ["pipe.csv", "loop.csv", "folder.csv", "zero.csv"])
@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_what_is_not_a_regular_file_is_refused_at_once(
    command: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, name]) > 0
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert name in printed.err


@pytest.mark.parametrize("key", ["plate.modes_file", "trackpad.replay_file", "device.calibration_file"])
@pytest.mark.parametrize("name", ["pipe.csv", "loop.csv", "folder.csv"])
def test_a_configuration_that_names_one_is_refused(key: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    section, entry = key.split(".")
    Path("hapticd.toml").write_text(f'[{section}]\n{entry} = "{name}"\n', encoding="utf-8")
    assert main(["run", "--check", "--config", "hapticd.toml"]) == 78
    assert capsys.readouterr().err.startswith(f"hapticd: hapticd.toml: {key}: there is no file ")


def test_a_file_is_read_up_to_its_bound() -> None:
    Path("file").write_bytes(b"12345")
    assert read_bounded(Path("file"), 5) == b"12345"
    with pytest.raises(OSError, match="More than 4 bytes"):
        read_bounded(Path("file"), 4)
    with pytest.raises(IsADirectoryError):
        open_regular(Path("folder.csv"))
