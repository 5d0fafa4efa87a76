"""The pictures: that they are written, and of what."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from hapticd.errors import HapticdError
from hapticd.sim import lockstep, picture
from hapticd.sim.lockstep import Run
from hapticd.sim.picture import Film

pytestmark = pytest.mark.long

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def run() -> Run:
    return lockstep.run("swap", seconds=3.2)


def size_px(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data.startswith(PNG)
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_two_films_are_drawn_side_by_side(run: Run, tmp_path: Path) -> None:
    ours, paper = Film.of(run, "hapticd"), Film.of(run, "the paper's scheme")
    picture.draw([ours], tmp_path / "one.png", w_limit_um=4.0)
    picture.draw([ours, paper], tmp_path / "two.png", w_limit_um=4.0, seconds=1.5)

    one, two = size_px(tmp_path / "one.png"), size_px(tmp_path / "two.png")
    assert two == (2 * one[0], one[1])


@pytest.mark.parametrize("scenario", ["paper-figure-11", "step"])
def test_a_run_is_drawn_as_a_png(scenario: str, tmp_path: Path) -> None:
    picture.draw_run(lockstep.run(scenario, seconds=1.3), tmp_path / "run.png")

    assert size_px(tmp_path / "run.png")[0] > 600


def test_a_run_without_fingers_can_be_drawn(tmp_path: Path) -> None:
    for scenario in ("rest", "step"):
        picture.draw_run(lockstep.run(scenario, seconds=0.2), tmp_path / f"{scenario}.png")
        assert size_px(tmp_path / f"{scenario}.png")[0] > 600


def test_a_scenario_without_fingers_of_its_own_is_drawn_without_a_legend_for_them(tmp_path: Path) -> None:
    picture.draw_run(lockstep.run("hands", seconds=0.2), tmp_path / "hands.png")
    assert size_px(tmp_path / "hands.png")[0] > 600


def test_the_quadrature_of_two_slipping_fingers_is_shown_whole(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    drawn = []
    canvas = picture._canvas
    monkeypatch.setattr(picture, "_canvas", lambda columns: drawn.append(canvas(columns)) or drawn[-1])
    run = lockstep.run("both-slip", seconds=1.0)

    picture.draw_run(run, tmp_path / "both.png")

    highest_um = float(np.abs(run.modal_um.imag).max())
    assert highest_um > 1.0
    assert drawn[0][1][1, 0].get_ylim() == (-highest_um, highest_um)


def test_a_window_of_a_film_is_judged_by_itself(run: Run) -> None:
    film = Film.of(run, "swap")
    window = film.between(1.0, 2.0)

    assert film.score == run.score
    assert len(window.t_s) == len(window.truth_um) == len(window.reference_um) == 2000
    assert window.t_s[0] >= 1.0
    assert window.t_s[-1] < 2.0
    still_um = np.abs(window.truth_um[200:, 1])
    assert window.score.leak_um == pytest.approx(math.sqrt(float(np.mean(still_um**2))))


def test_a_place_that_cannot_be_written_is_a_sentence(run: Run, tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match=r"swap.png: cannot be written \(No such file or directory\)"):
        picture.draw_run(run, tmp_path / "nowhere" / "swap.png")


def test_without_matplotlib_the_error_names_the_package(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)

    with pytest.raises(HapticdError, match=r'pip install "\.\[plot\]"'):
        picture.draw_run(run, tmp_path / "swap.png")
