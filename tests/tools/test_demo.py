"""The demo's comparison: its columns, its virtual runs and its summary."""

from __future__ import annotations

import pytest

from hapticd.config.sections import SimConfig
from hapticd.sim import lockstep
from hapticd.sim.picture import Film
from hapticd.tools.demo.columns import Column, VirtualRun, columns, live_column
from hapticd.tools.demo.program import summary

STATUS: dict[str, dict[str, float]] = {"latency_ms": {}}


PAPER = "the paper's scheme, reference plate, 2 modes"
REFERENCE, FINGERTIP = "hapticd, reference plate, 2 modes", "hapticd, fingertip plate, 4 modes"


@pytest.mark.parametrize(
    ("sim", "titles"),
    [
        (SimConfig(), [PAPER, REFERENCE, FINGERTIP]),
        (SimConfig(plate="fingertip", modes=4), [PAPER, REFERENCE, FINGERTIP]),
        (SimConfig(wiring="paper"), [f"{PAPER}, the paper's wires", f"{REFERENCE}, the paper's wires", FINGERTIP]),
        (SimConfig(wiring="swapped"), [PAPER, f"{REFERENCE}, swapped wires", FINGERTIP]),
        (SimConfig(modes=4), [PAPER, "hapticd, reference plate, 4 modes", FINGERTIP]),
        (SimConfig(plate="fingertip", modes=5), [PAPER, REFERENCE, "hapticd, fingertip plate, 5 modes"]),
    ],
    ids=[
        "usual",
        "fingertip plate",
        "the paper's wires",
        "wrong wires are the live column's alone",
        "4 modes",
        "5 modes",
    ],
)
def test_the_live_column_takes_the_place_of_its_plate_and_the_papers_scheme_is_compared(
    sim: SimConfig, titles: list[str]
) -> None:
    assert [column.title for column in columns(live_column(sim, is_bare=False), is_bare=False)] == titles


def test_a_bare_board_is_compared_with_bare_plates() -> None:
    live = live_column(SimConfig(), is_bare=True)
    assert [column.plate.sensor_noise_um for column in columns(live, is_bare=True)] == [0.0, 0.0, 0.0]


def test_the_summary_has_contacts_and_centres_of_every_column() -> None:
    live = live_column(SimConfig(), is_bare=False)
    run = lockstep.run("strokes", seconds=1.0)
    films = dict.fromkeys(columns(live, is_bare=False), Film.of(run, live.title))
    rows = {line[:26].strip(): line[26:].split() for line in summary(films, live, STATUS).splitlines()}
    assert rows["plate"] == ["reference", "reference", "fingertip"]
    assert rows["sticky contact, um RMS"] == [f"{run.score.contact_leak_um:.3f}"] * 3
    assert rows["slippery contact, um RMS"] == [f"{run.score.contact_slip_um:.3f}"] * 3
    assert rows["contrast of the two"] == [f"{run.score.contrast:.1f}"] * 3
    assert rows["sticky centre, um RMS"] == [f"{run.score.leak_um:.3f}"] * 3


@pytest.mark.long
def test_a_virtual_run_gives_the_window_of_the_lock_step_run() -> None:
    column: Column = live_column(SimConfig(), is_bare=False)
    virtual = VirtualRun(column, "strokes", 1)
    virtual.play(0.5, 1.0)
    film = virtual.film()
    same = Film.of(lockstep.run("strokes", seconds=1.0), column.title).between(0.5, 1.0)
    assert film.score == same.score
    assert film.t_s.tolist() == same.t_s.tolist()
