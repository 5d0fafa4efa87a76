"""Each part of the bench on small sizes: finite figures, and the orderings that its documents claim."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import pytest

from hapticd.bench import felt, firmware, modes, prediction, solver, tick
from hapticd.bench.loop import HAPTICD, PAPER, PERFECT
from hapticd.bench.recording import LANDED_NS, new_machine, play, record
from hapticd.bench.tables import Table, plain, render
from hapticd.config.sections import Config
from hapticd.daemon.machine import Machine
from hapticd.sim.fingers.scenarios import SCENARIOS

pytestmark = pytest.mark.long

UNITS = ("_us", "_ms", "_s", "_mm", "_um", "_hz", "_frac", "_jnd", "_count", "_correlation", "contrast", "_tenth")
PARTS: dict[str, Callable[[], tuple[Table, ...]]] = {
    "modes": lambda: modes.run(pairs=200, seeds=(1,), repeats=1, timed=20, plates=0),
    "prediction": lambda: prediction.run(seeds=(1, 2), repeats=1),
    "tick": lambda: tick.run(seconds=0.1, repeats=1, passes=8, wait_until=lambda _: None),
    "firmware": lambda: firmware.run(repeats=1, ticks=20),
    "solver": lambda: solver.run(problems=120, repeats=1, timed=5),
    "felt": lambda: felt.run(problems=6, repeats=1, starts=3, seeds=(1,), seconds=2.0),
}


@cache
def part(name: str) -> tuple[Table, ...]:
    return PARTS[name]()


@pytest.mark.parametrize("name", PARTS)
def test_every_figure_is_a_finite_number_with_its_unit_in_the_name(name: str) -> None:
    for table in part(name):
        written = json.loads(json.dumps(plain(table), allow_nan=False))
        assert written["alternatives"][written["default"]]
        for figures in written["alternatives"].values():
            for key, value in figures.items():
                assert math.isfinite(value), key
                assert key.endswith(UNITS), key
        assert written["default"] in render(table)


def test_a_map_is_limited_by_its_noise_and_not_by_its_interpolation() -> None:
    table, plates = part("modes")
    assert all(plates.figure(name, "error_hz") < 0.1 for name in plates.rows)
    ours_um, others_um = (table.figure(name, "leak_um") for name in ("bicubic", "RectBivariateSpline"))
    assert 0.003 < ours_um < 0.03
    assert ours_um == pytest.approx(others_um, rel=1e-3)
    assert table.figure("bicubic", "interpolation_um") < 1e-4


def test_the_default_predictor_errs_less_than_its_alternatives_on_either_pad() -> None:
    for table in part("prediction"):
        ours, *others = (table.figure(row, "strokes_mm") for row in ("default", "hold", "linear", "kalman_cv"))
        assert ours < min(others), table.name


def test_the_solvers_agree_and_never_break_a_limit() -> None:
    (points,), (contacts, _) = part("solver"), part("felt")
    for key in ("leak_um", "slip_error_um", "both_slip_error_um"):
        assert points.figure("solve_batch", key) == pytest.approx(points.figure("keep_zero", key), abs=1e-9)
    assert all(points.figure(name, "limits_broken_count") == 0 for name in ("keep_zero", "solve_batch"))
    assert points.figure("keep_zero", "leak_um") < 1e-9 < 0.01 < points.figure("least_squares", "leak_um")
    for fingers, modes_ in felt.SIZES:
        name = f"{fingers} contacts, {modes_} modes"
        ours, bound = contacts.figure(name, "felt_frac"), contacts.figure(f"{name}, bound", "felt_frac")
        assert ours >= bound - 0.34, name  # two of six problems


def test_the_more_modes_the_more_is_felt_as_asked_and_more_than_by_the_papers_scheme() -> None:
    _, loop = part("felt")
    named = [f"{plate} plate, {count} modes" for plate, count in felt.LOOPS]
    ours, paper, perfect = (
        [loop.figure(f"{name}: {scheme}", "felt_frac") for name in named] for scheme in (HAPTICD, PAPER, PERFECT)
    )
    assert ours == sorted(ours)
    assert ours[0] < 0.02 < ours[1] < ours[-1]
    for one, best, papers in zip(ours[1:], perfect[1:], paper[1:], strict=True):
        assert papers < one <= best + 0.02


def test_a_law_is_bounded_by_the_voltage_and_the_default_is_nearest() -> None:
    (table,) = part("firmware")
    for figure in ("small_ms", "large_ms", "worst_ms"):
        bound, *laws = (table.figure(row, figure) for row in ("the voltage's bound", *firmware.LAWS))
        assert bound < min(laws)
        assert laws[0] <= min(laws[2:]), figure


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
