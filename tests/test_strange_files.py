"""Commands given a pipe, a device, a folder or a loop of links for a file: one sentence at once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.regular_file import MAX_LINE_CHARACTERS, open_regular, read_bounded, read_lines
from hapticd_client import RefusedError, content

READERS = [
    ("run", "--check", "--config"),
    ("replay",),
    ("export", "--csv", "tables"),
    ("plate", "map", "--finger=1,2", "--modes"),
    ("calibrate", "friction", "--out", "plate", "--readings"),
    ("calibrate", "modes", "--out", "plate", "--scan"),
    ("service", "keys", "allow", "."),
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


@pytest.mark.parametrize("key", ["plate.modes_file", "device.calibration_file"])
@pytest.mark.parametrize("name", ["pipe.csv", "loop.csv", "folder.csv"])
def test_a_configuration_that_names_one_is_refused(key: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    section, entry = key.split(".")
    Path("hapticd.toml").write_text(f'[{section}]\n{entry} = "{name}"\n', encoding="utf-8")
    assert main(["run", "--check", "--config", "hapticd.toml"]) == 78
    assert capsys.readouterr().err.startswith(f"hapticd: hapticd.toml: {key}: there is no file ")


def test_lines_are_read_up_to_their_bounds() -> None:
    Path("lines").write_bytes("\ufeffa\r\nb\n\nc".encode())
    assert list(read_lines(Path("lines"), 4)) == [(1, "a"), (2, "b"), (3, ""), (4, "c")]
    with pytest.raises(OSError, match="More than 3 lines"):
        list(read_lines(Path("lines"), 3))
    Path("lines").write_bytes(b"x" * (MAX_LINE_CHARACTERS + 1))
    with pytest.raises(OSError, match="Line 1 has more than"):
        list(read_lines(Path("lines"), 3))


def test_a_file_is_read_up_to_its_bound() -> None:
    Path("file").write_bytes(b"12345")
    assert read_bounded(Path("file"), 5) == b"12345"
    with pytest.raises(OSError, match="More than 4 bytes"):
        read_bounded(Path("file"), 4)
    with pytest.raises(IsADirectoryError):
        open_regular(Path("folder.csv"))


@pytest.mark.parametrize("suffix", content.SUFFIXES)
@pytest.mark.parametrize("name", ["pipe", "folder", "zero"])
def test_content_that_is_not_a_regular_file_is_refused_at_once(name: str, suffix: str) -> None:
    path = Path(name + suffix)
    if not path.exists():
        path.symlink_to(f"{name}.csv")
    with pytest.raises(RefusedError, match="cannot be read \\(Not a regular file\\)") as refused:
        content.load(path)
    assert str(path) in str(refused.value)
