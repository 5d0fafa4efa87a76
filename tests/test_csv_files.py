"""CSV files as spreadsheets write them, by each reader of hapticd."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapticd.errors import HapticdError
from hapticd.formats.mode_map import read_scan
from hapticd.sim.fingers import trajectories
from hapticd.tools.calibrate import friction

FINGERS = "t_s,finger,x_mm,y_mm,target_um\n0,1,-5,0,1\n0.5,1,,,\n1,1,7,2,0.5\n"
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "modes": (
        "x_mm,y_mm,phi_1\n" + "".join(f"{x},{y},{x * y}.5\n" for x in range(4) for y in range(4)),
        lambda path: np.column_stack(read_scan(path)[:2]).tolist(),
    ),
    "friction": (
        "amplitude_um,friction\n0,0.8\n1,0.5\n2,0.2\n",
        lambda path: np.array(friction.read(path)[:2]).tolist(),
    ),
    "fingers": (FINGERS, lambda path: str(trajectories.read(path, (137.5, 137.5)).seconds)),
}
each_reader = pytest.mark.parametrize("name", READERS)


def quoted(text: str) -> str:
    return "".join(",".join(f'"{cell}"' for cell in line.split(",")) + "\n" for line in text.splitlines())


@each_reader
@pytest.mark.parametrize(
    "changed",
    [
        quoted,
        lambda text: quoted(text).replace(",", ", ").replace("\n", "\r\n"),
        lambda text: "\ufeff  # mine, and yours\n\n" + text.replace(",", " ,\t"),
    ],
    ids=["quoted", "blanks", "comments"],
)
def test_quotes_blanks_and_comments_change_nothing(name: str, changed: Callable[[str], str], tmp_path: Path) -> None:
    text, read = READERS[name]
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(text, encoding="utf-8")
    other.write_text(changed(text), encoding="utf-8", newline="")
    assert read(other) == read(plain)


@each_reader
def test_a_quote_that_is_not_closed_is_one_sentence(name: str, tmp_path: Path) -> None:
    text, read = READERS[name]
    path = tmp_path / "open.csv"
    path.write_text(text + '"' + "1,2,3\n" * 30_000, encoding="utf-8")
    with pytest.raises(HapticdError, match=r"open\.csv"):
        read(path)
