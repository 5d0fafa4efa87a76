"""Each part of the bench on small sizes: finite figures, and the orderings that its documents claim."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import pytest

from hapticd.bench import felt, felt_asked, firmware, leak, modes, prediction, solver, tick
from hapticd.bench.recording import LANDED_NS, new_machine, play, record
from hapticd.bench.tables import UNITS, Table, plain, render
from hapticd.config.sections import Config
from hapticd.daemon.machine import LOOK_EVERY_NS, TIMER_NS, Machine
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.plate.glasses import FINGERTIP, WIDE

pytestmark = pytest.mark.long

ASKED = ((FINGERTIP, 4, 1.0, 1.0), (FINGERTIP, 4, 0.5, 1.0), (WIDE, 8, 1.0, 1.0), (WIDE, 8, 1.0, 0.3))
# Tables that take long are each their own: each test has a limit of time.
PARTS: dict[str, Callable[[], tuple[Table, ...]]] = {
    "modes": lambda: (modes.run(pairs=200, seeds=(1,), repeats=1, timed=20),),
    "prediction": lambda: prediction.run(seeds=(1, 2), repeats=1),
    "tick": lambda: tick.run(seconds=0.1, repeats=1, passes=8, wait_until=lambda _: None),
    "firmware": lambda: firmware.run(repeats=1, ticks=20),
    "solver": lambda: (solver.run(problems=120, repeats=1, timed=5), felt.run(problems=6, repeats=1, starts=3)),
    "leak": lambda: (leak.run(seeds=(1,), seconds=2.0, names=(leak.PAPER, "predictor hold", "a single knot")),),
    "leak_contact": lambda: (leak.contact(seeds=(1,), seconds=2.0),),
    "felt_asked": lambda: (felt_asked.run(cases=ASKED, seeds=(1,), seconds=2.0),),
}


@cache
def part(name: str) -> tuple[Table, ...]:
    return PARTS[name]()


def figure(table: Table, alternative: str, name: str) -> float:
    return table.row(alternative).figures[name]


@pytest.mark.parametrize("name", PARTS)
def test_every_figure_is_a_finite_number_with_its_unit_in_the_name(name: str) -> None:
    for table in part(name):
        alternatives = json.loads(json.dumps(plain(table), allow_nan=False))["alternatives"]
        assert alternatives[table.default]
        for figures in alternatives.values():
            for key, value in figures.items():
                assert math.isfinite(value), key
                assert key.endswith((*UNITS, "_ratio", "_change", "contrast", "contrast_median")), key
        assert table.default in render(table)


def test_a_map_is_limited_by_its_noise_and_not_by_its_interpolation() -> None:
    (table,) = part("modes")
    leaks = {row.name: row.figures["leak_um_per_um"] for row in table.rows}
    assert 0.003 < leaks["bicubic"] < 0.03
    assert leaks["bicubic"] < leaks["bilinear"]
    assert leaks["bicubic"] == pytest.approx(leaks["RectBivariateSpline"], rel=1e-3)
    assert (
        figure(table, "bicubic", "interpolation_um_per_um")
        < 1e-4
        < figure(table, "bilinear", "interpolation_um_per_um")
    )


def test_what_a_scene_does_not_need_is_skipped() -> None:
    situations, messages = part("tick")
    assert all(0.0 < row.figures["hot_us"] < 1e4 for row in messages.rows)
    skipped = {row.name: row.figures["skipped_frac"] for row in situations.rows}
    assert skipped["no target"] == skipped["standing"] == 1.0
    assert skipped["no finger"] == pytest.approx(TIMER_NS / LOOK_EVERY_NS)
    assert skipped[tick.DEFAULT] == skipped[tick.FIVE_FINGERS] == 0.0


def test_the_solvers_agree_and_never_break_a_limit() -> None:
    points, contacts = part("solver")
    for key in ("leak_um", "slip_error_um", "both_slip_error_um"):
        assert figure(points, "solve_batch", key) == pytest.approx(figure(points, "solve", key), abs=1e-9)
    ours = [row for row in points.rows if row.name.startswith("solve")]
    assert all(row.figures["limits_broken_count"] == 0 for row in ours)
    assert (
        figure(points, "solve", "leak_um") < solver.NOTHING_UM < 0.01 < figure(points, "numpy solve + clip", "leak_um")
    )
    for fingers, modes_ in felt.SIZES:
        name = f"{fingers} contacts, {modes_} modes"
        ours, bound = figure(contacts, name, "felt_frac"), figure(contacts, f"{name}, bound", "felt_frac")
        assert ours >= bound - 0.34, name  # two of six problems


def test_the_more_modes_the_more_is_felt_as_asked() -> None:
    (contact,) = part("leak_contact")
    contrast, felt_frac = ({row.name: row.figures[name] for row in contact.rows} for name in ("contrast", "felt_frac"))
    named = [f"{plate} plate, {count} modes" for plate, count in leak.CONTACT_PLATES]
    assert contrast[named[0]] < 2.0 < contrast[named[1]] < contrast[named[2]]
    assert felt_frac[named[0]] < 0.02 < felt_frac[named[2]] < felt_frac[named[3]] < felt_frac[named[4]]


# --- the tick's instruments ---


def test_a_recording_played_again_makes_the_machine_write_the_same_bytes() -> None:
    recording = record(SCENARIOS["strokes"].build(1, 100.0), seconds=1.2)
    written: list[list[bytes]] = [[], []]
    for said in written:
        machine = Machine(Config(), recording.modes, write_board=lambda data, said=said: said.append(data) is None)
        passes = play(recording, machine)
    assert written[0] == written[1]
    assert len(written[0]) > len(passes)
    assert len(passes) == sum(call.name == "reports" and call.t_ns >= LANDED_NS for call in recording.calls) > 20
    assert machine.pipeline.counters.solves > len(passes)


def test_paced_passes_wait_for_their_time() -> None:
    recording = record(SCENARIOS["strokes"].build(1, 100.0), seconds=1.0)
    due_ns: list[int] = []
    play(recording, new_machine(recording), wait_until=due_ns.append, limit=5)
    assert len(due_ns) == 5
    assert all(11_000_000 < later - sooner < 11_500_000 for sooner, later in pairwise(due_ns))


def test_what_is_asked_is_felt_more_often_the_less_is_asked_and_the_more_modes_there_are() -> None:
    (table,) = part("felt_asked")
    felt_frac, perfect_frac, paper_frac = (
        {row.name: row.figures[name] for row in table.rows} for name in ("felt_frac", "perfect_frac", "paper_frac")
    )
    four, half, eight, weak = felt_frac
    assert "reach x 0.3" in weak
    assert felt_frac[four] < felt_frac[half] < felt_frac[eight]
    assert felt_frac[weak] < felt_frac[eight] - 0.1
    assert all(felt_frac[name] <= perfect_frac[name] + 0.05 for name in felt_frac)
    assert max(paper_frac.values()) < 0.2
