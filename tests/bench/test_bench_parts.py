"""Each part of the bench on small sizes: finite figures, and the orderings that do not hang on a clock."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import pytest

from hapticd.bench import (
    firmware,
    knots,
    leak,
    modes,
    prediction,
    solver,
    solver_contacts,
    solver_sizes,
    solver_tracks,
    stability,
    tick,
)
from hapticd.bench.baselines import PREDICTORS
from hapticd.bench.recording import LANDED_NS, new_machine, play, record
from hapticd.bench.stopwatch import STAGES, Stopwatch
from hapticd.bench.tables import UNITS, Table, plain, render
from hapticd.compiled import why_interpreted
from hapticd.config.sections import Config
from hapticd.daemon.machine import LOOK_EVERY_NS, TIMER_NS, Machine
from hapticd.sim.fingers.scenarios import SCENARIOS

PARTS: dict[str, Callable[[], tuple[Table, ...]]] = {
    "modes": lambda: (modes.run(pairs=120, seeds=(1,), repeats=1, calls=5),),
    "prediction": lambda: prediction.run(seeds=(1, 2), repeats=1),
    "solver": lambda: (
        solver.run(problems=120, repeats=1, timed=5),
        *solver_tracks.run(strokes=6, repeats=1),
        solver_contacts.run(pairs=60, repeats=1),
        solver_sizes.run(calls=1, repeats=1),
    ),
    "knots": lambda: knots.run(seconds=0.3, repeats=1),
    "stability": lambda: stability.run(problems=5, steps=10_000),
    "tick": lambda: tick.run(seconds=0.1, repeats=1, passes=8, wait_until=lambda _: None),
    "leak": lambda: (leak.run(seeds=(1,), seconds=2.0, names=SWAPS), leak.both_slip(seeds=(1,), seconds=4.0)),
    "firmware": lambda: firmware.run(
        frequencies_hz=(10.0,), speeds_mm_s=(100.0,), qualities=(500.0,), repeats=1, ticks=20
    ),
}
SWAPS = ("predictor hold", "a single knot", "the paper's scheme")


@cache
def part(name: str) -> tuple[Table, ...]:
    return PARTS[name]()


def figure(table: Table, alternative: str, name: str) -> float:
    return table.row(alternative).figures[name]


@pytest.mark.parametrize("name", PARTS)
def test_every_figure_is_a_finite_number_with_its_unit_in_the_name(name: str) -> None:
    for table in part(name):
        told = json.loads(json.dumps(plain(table), allow_nan=False))
        assert told["alternatives"][table.default]
        for figures in told["alternatives"].values():
            for key, value in figures.items():
                assert math.isfinite(value), key
                assert key.endswith((*UNITS, "_ratio")), key
        for compared in table.compared:
            assert compared in table.row(table.default).figures
        assert table.default in render(table)


def test_nearest_neighbours_leak_most_and_the_fit_pays() -> None:
    (table,) = part("modes")
    leak_um = {row.name: row.figures["leak_um_per_um"] for row in table.rows}
    assert leak_um["nearest, fitted map"] > 4 * leak_um[modes.DEFAULT]
    assert leak_um["bicubic at, raw scan"] > 2 * leak_um[modes.DEFAULT]
    assert leak_um["bicubic evaluate, fitted map"] == leak_um[modes.DEFAULT]
    assert leak_um[modes.DEFAULT] <= leak_um["bilinear, fitted map"]


def test_an_outside_spline_agrees_with_ours() -> None:
    pytest.importorskip("scipy")
    (table,) = part("modes")
    outside = figure(table, "RectBivariateSpline, fitted map", "leak_um_per_um")
    assert outside == pytest.approx(figure(table, modes.DEFAULT, "leak_um_per_um"), rel=0.02)


def test_adaptive_knots_err_several_times_less_than_the_staircase_and_send_less_than_dense_ones() -> None:
    for table in part("knots"):
        ours, steps = figure(table, knots.DEFAULT, "error_um"), figure(table, "a step a report", "error_um")
        assert ours < steps / 4
        bytes_sent = figure(table, knots.DEFAULT, "frame_bytes_count")
        assert bytes_sent < figure(table, "dense, 0.7 ms", "frame_bytes_count")


def test_on_no_motion_does_another_predictor_err_less_by_a_twentieth() -> None:
    for table in part("prediction"):
        for name in table.columns():
            if name.endswith("_mm"):
                # Overshoot is told of those that look ahead: who holds still has none but the noise's.
                rivals = set(PREDICTORS) - ({"hold"} if name == "overshoot_mm" else set())
                least_mm = min(figure(table, rival, name) for rival in rivals)
                assert figure(table, "default", name) <= 1.05 * least_mm, name


def test_no_part_of_the_default_predictor_is_there_for_nothing() -> None:
    strokes, _ = part("prediction")
    ours = strokes.row("default").figures
    assert figure(strokes, "default, noise as given", "quiet_strokes_mm") > 1.1 * ours["quiet_strokes_mm"]
    assert figure(strokes, "default, stamps as given", "fast_straight_mm") > 2.0 * ours["fast_straight_mm"]
    assert figure(strokes, "hold", "strokes_mm") > 5.0 * ours["strokes_mm"]
    assert ours["strokes_25ms_mm"] > ours["strokes_mm"]


def test_knowing_the_motion_helps_a_linear_filter_most_on_sines() -> None:
    strokes, turns = part("prediction")
    assert figure(turns, prediction.BOUND, "fast_sine_mm") < 0.5 * figure(turns, "default", "fast_sine_mm")
    assert figure(strokes, prediction.BOUND, "strokes_mm") > 0.85 * figure(strokes, "default", "strokes_mm")


def test_numpy_fits_the_parabola_that_we_fit() -> None:
    for table in part("prediction"):
        for name in table.columns():
            if name.endswith("_mm"):
                assert figure(table, "numpy polyfit", name) == pytest.approx(figure(table, "least_squares", name))


def test_our_solvers_agree_and_never_break_a_limit() -> None:
    table = part("solver")[0]
    ours = table.row("solve_fast").figures
    for name in ("solve", "solve_batch"):
        for key in ("leak_um", "slip_error_um", "both_slip_error_um"):
            assert figure(table, name, key) == pytest.approx(ours[key], abs=1e-9)
    assert all(row.figures["limits_broken_count"] == 0 for row in table.rows if row.name.startswith("solve"))
    assert ours["leak_um"] < solver.NOTHING_UM


def test_cutting_each_mode_at_its_limit_by_itself_leaks() -> None:
    table = part("solver")[0]
    assert figure(table, "numpy solve + clip", "leak_um") > 0.01
    assert figure(table, "solve_fast", "both_slip_error_um") < figure(table, "numpy solve + clip", "both_slip_error_um")


def test_a_general_solver_of_quadratic_programmes_finds_our_solution() -> None:
    pytest.importorskip("daqp")
    table = part("solver")[0]
    assert figure(table, "daqp", "leak_um") < 1e-6
    assert figure(table, "daqp", "slip_error_um") == pytest.approx(
        figure(table, "solve_fast", "slip_error_um"), abs=1e-6
    )


def test_phases_sag_less_often_than_signs_and_miss_less_far_out() -> None:
    table = part("solver")[1]
    assert figure(table, "solve_phased_fast", "sags_count") < 0.5 * figure(table, "solve_fast", "sags_count")
    assert figure(table, "solve_phased_fast", "far_error_um") < figure(table, "solve_fast", "far_error_um")


def test_a_general_minimiser_finds_nothing_better_for_targets_out_of_reach() -> None:
    pytest.importorskip("scipy")
    table = part("solver")[1]
    # every tenth knot against all of them: the same figure but for the sample
    assert figure(table, "solve_phased_fast", "far_error_um") == pytest.approx(
        figure(table, "L-BFGS-B", "far_error_um"), rel=0.05
    )


def test_through_singular_positions_ours_usually_steps_far_less_than_the_inverse() -> None:
    table = part("solver")[2]
    ours, papers = (figure(table, name, "usual_singular_step_um") for name in ("solve_fast", "solve_fast, paper"))
    assert 3 * ours < papers
    shares = [
        figure(table, name, "share_frac") for name in ("solve_fast", "solve_fast, 3 modes", "solve_fast, 4 modes")
    ]
    assert shares == sorted(shares)


def test_a_disc_s_own_axis_leaks_least_over_the_contact_of_all_with_one_line() -> None:
    table = part("solver")[3]
    disc = figure(table, "disc", "contact_leak_um")
    assert disc < figure(table, "point", "contact_leak_um")
    for name in ("disc, solve with gram", "disc, solve_batch with gram"):
        assert figure(table, name, "contact_leak_um") == pytest.approx(disc)


def test_nothing_fails_at_the_ends_of_the_solver_s_range() -> None:
    situations, walk, *_ = part("stability")
    for row in situations.rows:
        assert row.figures["failures_count"] == row.figures["limits_broken_count"] == 0, row.name
        assert row.figures["leak_um"] < 1e-12, row.name
        assert row.figures["wire_leak_um"] < 1e-3, row.name
    assert figure(situations, "condition 1", "digits_one_still_count") >= 14
    assert (
        figure(situations, "condition 1e+08", "digits_one_still_count") >= 7
    )  # the rows' own digits less the condition
    for row in walk.rows:
        assert row.figures["drift_um"] < stability.NOTHING_UM, row.name
    assert figure(walk, "solve_fast, one still", "drift_um") == 0.0


def test_outside_references_that_are_missing_are_left_out_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (modes, solver, solver_tracks, stability):
        monkeypatch.setattr(module, "optional", lambda _: None)
    for table in (
        modes.run(pairs=5, seeds=(1,), repeats=1, calls=1),
        solver.run(problems=5, repeats=1, timed=1),
        solver_tracks.run(strokes=1, repeats=1)[0],
        stability.situations(1),
    ):
        assert table.skipped
        assert not [row.name for row in table.rows if row.name.startswith(tuple(table.skipped))]
        assert all(f"{name}: left out" in render(table) for name in table.skipped)


def test_ours_leaks_less_than_the_paper_s_scheme_and_more_than_perfect_knowledge() -> None:
    table, _ = part("leak")
    leaks_um = {row.name: row.figures["leak_um"] for row in table.rows}
    assert set(leaks_um) == {leak.DEFAULT, *SWAPS, leak.PERFECT}
    assert leaks_um[leak.PERFECT] < leak.NOTHING_UM < leaks_um[leak.DEFAULT]
    assert leaks_um["predictor hold"] > 3 * leaks_um[leak.DEFAULT]
    assert leaks_um[leak.PAPER] > 4 * leaks_um[leak.DEFAULT]
    assert leaks_um["a single knot"] > leaks_um[leak.DEFAULT]


def test_two_slippery_fingers_dip_less_when_their_phase_turns_than_when_signs_flip() -> None:
    _, table = part("leak")
    for name in ("slip_error_um", "dip_frac", "step_um"):
        assert figure(table, leak.DEFAULT, name) < figure(table, leak.SIGNS_ALONE, name)
    assert figure(table, leak.SIGNS_ALONE, "slip_error_um") < figure(table, leak.PAPER, "slip_error_um")


def test_every_alternative_of_the_leak_is_a_run_s_settings_of_its_own() -> None:
    settings = leak.alternatives()
    assert len(set(settings.values())) == len(settings)


def test_the_default_law_is_the_best_over_all_corners_and_the_paper_s_the_last() -> None:
    step, corners, tracking, strokes = part("firmware")
    for name in ("small_ms", "large_ms"):
        bound, default = figure(corners, f"{firmware.BOUND}, Q 500", name), figure(corners, "deadbeat, Q 500", name)
        assert bound < default < figure(corners, "pi_ff, Q 500", name) < figure(corners, "pi, Q 500", name)
    assert figure(step, "deadbeat", "landing_ms") < figure(step, "pi_ff", "landing_ms")
    assert figure(step, "LQG (outside)", "large_ms") < figure(step, "pi", "large_ms")
    assert figure(tracking, "pi, 10 Hz", "delay_ms") > 0.5 > figure(tracking, "deadbeat, 10 Hz", "delay_ms")
    assert figure(strokes, "deadbeat, 100 mm/s", "leak_um") < figure(strokes, "pi, 100 mm/s", "leak_um")
    for row in step.rows:
        assert row.figures.get("largest_voltage_v", 0.0) <= 150.0 * (1 + 1e-6)
    for row in tracking.rows:
        assert row.figures["residual_um"] <= 1.01 * row.figures["error_um"]  # which counts the ends too


def test_what_a_scene_does_not_need_is_skipped() -> None:
    stages, situations = part("tick")
    assert [row.name for row in stages.rows] == [tick.WHOLE, *STAGES, tick.REST]
    assert all(row.figures["hot_us"] > 0.0 for row in stages.rows[:-1])
    skipped = {row.name: row.figures["skipped_frac"] for row in situations.rows}
    assert skipped["no target"] == skipped["standing"] == 1.0
    assert skipped["no finger"] == pytest.approx(TIMER_NS / LOOK_EVERY_NS)
    assert skipped[tick.DEFAULT] == skipped["a single knot"] == 0.0


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


@pytest.mark.skipif(why_interpreted() == "", reason="machine code is not watched: the next test does it as Python")
def test_the_stopwatch_sees_every_stage_and_leaves_no_trace() -> None:
    originals = {stage: [vars(owner)[name] for owner, name in places] for stage, places in STAGES.items()}
    recording = record(SCENARIOS["strokes"].build(1, 100.0), seconds=1.0)
    stopwatch = Stopwatch()
    with stopwatch.on_every_stage():
        play(recording, new_machine(recording), before=stopwatch.reset, limit=5)
    assert all(taken_us > 0.0 for taken_us in stopwatch.taken_us().values())
    assert originals == {stage: [vars(owner)[name] for owner, name in places] for stage, places in STAGES.items()}


def test_the_stopwatch_does_so_in_a_process_that_runs_python() -> None:
    this = f"{__file__}::{test_the_stopwatch_sees_every_stage_and_leaves_no_trace.__name__}"
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist", this]
    done = subprocess.run(command, env={**os.environ, "HAPTICD_PURE": "1"}, capture_output=True, text=True, check=False)
    assert "1 passed" in done.stdout, done.stdout + done.stderr
