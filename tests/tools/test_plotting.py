"""Pictures: written in the format of their suffix, and errors before the work."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hapticd.errors import HapticdError, UsageError
from hapticd.tools import outputs, plotting


@pytest.mark.parametrize(
    ("suffix", "begin"), [(".png", b"\x89PNG"), (".PNG", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")]
)
def test_a_picture_has_the_format_of_its_suffix(suffix: str, begin: bytes, tmp_path: Path) -> None:
    figure, axes = plotting.subplots(2.0, 1.0, 1, 2, sharey=True)
    assert axes.shape == (1, 2)
    for colours in (None, 8):
        plotting.save(figure, tmp_path / f"picture{suffix}", colours=colours)
        assert (tmp_path / f"picture{suffix}").read_bytes().startswith(begin)


def test_another_suffix_is_refused_before_the_work() -> None:
    outputs.check_suffix(Path("picture.png"), outputs.PICTURE)
    for name in ("picture", "picture.txt", ".png"):
        with pytest.raises(UsageError, match=r"end it in \.png or \.pdf or \.svg"):
            outputs.check_suffix(Path(name), outputs.PICTURE)


def test_without_matplotlib_the_command_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(HapticdError, match=f"run `{sys.executable} -m pip install 'matplotlib>="):
        plotting.subplots(1.0, 1.0)
