"""The demo's comparison: its columns, its virtual runs and its summary."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pictures import faults

from hapticd.errors import HapticdError
from hapticd.sim import lockstep
from hapticd.sim.fingers.scenarios import REAL
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings
from hapticd.tools.demo.columns import COLUMNS, LIVE, DemoColumn, virtual_film
from hapticd.tools.demo.film import Film
from hapticd.tools.demo.picture import draw, typical_instant
from hapticd.tools.demo.program import COMPARED_S, SCENARIO, VIRTUAL_START_S, _connected, line, summary
from hapticd_client import FingerState, PlateState

STATUS: dict[str, dict[str, float]] = {"latency_ms": {}}


PAPER = "the paper's scheme, reference plate, 2 modes"
REFERENCE = "hapticd, reference plate, 2 modes"


def second(title: str) -> Film:
    """The first second of strokes on the reference plate."""
    run = lockstep.run("strokes", seconds=1.0)
    return Film.between(title, run.settings.plate, partial(getattr, run), 0.0, 1.0)


def test_the_summary_has_contacts_and_centres_of_every_column() -> None:
    run = second(LIVE.title)
    films = dict.fromkeys(COLUMNS, run)
    rows = {row[:26].strip(): row[26:].split() for row in summary(films, STATUS).splitlines()}
    assert rows["plate"] == ["reference", "fingertip", "wide"]
    assert rows["both felt as asked"] == [f"{run.score.felt_frac:.0%}"] * 3
    sticky = run.score.fingers[1]
    errors = f"{sticky.bias_jnd:.1f}, {sticky.median_jnd:.1f}, {sticky.error_95_jnd:.1f}"
    assert rows["sticky error, JND"] == errors.split() * 3
    assert rows["sticky contact, um RMS"] == [f"{run.score.contact_leak_um:.3f}"] * 3
    assert rows["slippery contact, um RMS"] == [f"{run.score.contact_slip_um:.3f}"] * 3
    assert rows["contrast of the two"] == [f"{run.score.contrast:.1f}"] * 3
    assert rows["sticky centre, um RMS"] == [f"{run.score.leak_um:.3f}"] * 3
    assert "times less vibration" in summary(films, STATUS)


def test_a_plate_that_is_not_driven_is_not_praised_for_its_silence() -> None:
    film = second(LIVE.title)
    silent = replace(film, score=replace(film.score, leak_um=1e-4, slip_frac=0.0))
    assert "times less" not in summary({**dict.fromkeys(COLUMNS, film), LIVE: silent}, STATUS)


def test_the_picture_shows_the_plate_with_both_fingers_and_what_each_gets(tmp_path: Path, figures: list[Any]) -> None:
    paper, ours = second(PAPER), second(REFERENCE)
    draw([paper, ours], tmp_path / "demo.png", seconds=0.9, source="demo")
    papers, hapticds, plate, _ = figures[0].axes
    at = typical_instant(ours, 0.9)
    t_s, got, asked = ours.contacts(0.9)
    here = t_s.tolist().index(ours.t_s[at])
    assert asked[here].tolist() == pytest.approx([math.exp(-1.0 / 0.7), 1.0])
    assert [text.get_text() for text in plate.texts] == [
        f"finger 1: asked 0.24, feels {got[here, 0]:.2f}",
        f"finger 2: asked 1.00, feels {got[here, 1]:.2f}",
    ]
    assert {tuple(patch.center) for patch in plate.patches} == {tuple(place) for place in ours.finger_true_mm[at]}
    assert papers.get_title(loc="left") == f"the paper's scheme: as asked {paper.score.felt_frac:.0%} of the time"
    assert hapticds.get_title(loc="left") == f"hapticd: as asked {ours.score.felt_frac:.0%} of the time"
    assert papers.get_ylim() == hapticds.get_ylim()
    assert faults(figures[0]) == []


@pytest.mark.long
def test_the_front_page_says_the_share_that_the_demo_prints_and_draws() -> None:
    film = virtual_film(COLUMNS[-1], SCENARIO, 1, VIRTUAL_START_S, VIRTUAL_START_S + COMPARED_S)
    shown = f"within one JND {100 * film.score.felt_frac:.0f} % of the time, two"
    assert shown in Path(__file__).parents[2].joinpath("README.md").read_text(encoding="utf-8")


def test_a_daemon_that_ends_is_not_waited_for(tmp_path: Path) -> None:
    ended = SimpleNamespace(process=SimpleNamespace(poll=lambda: 1), runtime_dir=tmp_path)
    with pytest.raises(HapticdError, match="daemon"):
        _connected(ended)  # type: ignore[arg-type]


def test_a_virtual_run_gives_the_window_of_the_lock_step_run() -> None:
    column = DemoColumn("hapticd", PlateSettings())
    film = virtual_film(column, "strokes", 1, 0.5, 1.0)
    run = lockstep.run("strokes", settings=Settings(motion=REAL), seconds=1.0)
    same = Film.between(column.title, column.plate, partial(getattr, run), 0.5, 1.0)
    assert film.plate_um.tobytes() == same.plate_um.tobytes()
    assert film.score == same.score


def test_a_line_has_the_target_and_the_amplitude_of_each_finger_that_has_one() -> None:
    fingers = (
        FingerState(1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.9, False),
        FingerState(2, 9.0, 9.0, 9.0, 9.0, 0.0, 0.0, False),
        FingerState(3, 9.0, 9.0, 9.0, 9.0, None, None, False),
    )
    state = PlateState(1, 1, 0, "ACTIVE", fingers, (1.5, -2.25), True, 10.4, 15.6)
    assert line(state) == "ACTIVE  horizon 15.6 ms  1: 1.00 -> 0.90 um  2: 0.00 -> 0.00 um  limited"
