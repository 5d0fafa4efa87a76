"""The solver's tables on small sizes: the orderings that do not depend on a clock."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache

import pytest

from hapticd.bench import contacts, felt, felt_walk, solver, stability
from hapticd.bench.tables import UNITS, Table, plain
from hapticd.core.solver.contacts import STILL_IMPORTANCE

pytestmark = pytest.mark.long

TABLES: dict[str, Callable[[], Table]] = {
    "solver": lambda: solver.run(problems=120, repeats=1, timed=5),
    "contacts": lambda: contacts.run(problems=4, repeats=1),
    "felt": lambda: felt.run(problems=6, repeats=1, starts=3),
    "sizes": lambda: solver.sizes(calls=1, repeats=1),
    "many": lambda: solver.many(problems=60, repeats=1, timed=1),
    "situations": lambda: stability.situations(problems=5),
    "walk": lambda: stability.walk(steps=10_000),
    "contacts_walk": lambda: contacts.walk(steps=0),  # three laps
    "felt_walk": lambda: felt_walk.run(steps=0),  # three laps of each kind
    "contacts_frontier": lambda: contacts.frontier(seeds=(1,), every_s=0.1),
}


@cache
def table(name: str) -> Table:
    return TABLES[name]()


def figure(name: str, alternative: str, key: str) -> float:
    return table(name).row(alternative).figures[key]


@pytest.mark.parametrize("name", TABLES)
def test_every_figure_is_a_finite_number_with_its_unit_in_the_name(name: str) -> None:
    figures = json.loads(json.dumps(plain(table(name)), allow_nan=False))
    assert figures["alternatives"][table(name).default]
    for row in figures["alternatives"].values():
        for key, value in row.items():
            assert math.isfinite(value), key
            assert key.endswith((*UNITS, "_ratio", "contrast", "contrast_median")), key


def test_the_solvers_agree_and_never_break_a_limit() -> None:
    for name in ("solve", "solve_batch"):
        for key in ("leak_um", "slip_error_um", "both_slip_error_um"):
            assert figure("solver", name, key) == pytest.approx(figure("solver", "solve_fast", key), abs=1e-9)
    ours = [row for row in table("solver").rows if row.name.startswith("solve")]
    assert all(row.figures["limits_broken_count"] == 0 for row in ours)
    assert figure("solver", "solve_fast", "leak_um") < solver.NOTHING_UM


def test_clamping_each_mode_by_itself_leaks() -> None:
    naive = table("solver").row("numpy solve + clip").figures
    assert naive["leak_um"] > 0.01
    assert figure("solver", "solve_fast", "both_slip_error_um") < naive["both_slip_error_um"]


def test_many_fingers_miss_less_by_phases_than_by_the_best_signs_and_no_still_one_moves() -> None:
    phases, signs, best = (
        figure("many", name, "missed_um") for name in ("phases by descent", "signs by descent", "best of all signs")
    )
    assert phases < best
    assert best * (1.0 - 1e-9) < signs < 1.1 * best
    assert all(row.figures["leak_um"] < solver.NOTHING_UM for row in table("many").rows)


def test_a_general_solver_of_quadratic_programmes_finds_the_same_solution() -> None:
    pytest.importorskip("daqp")
    assert figure("solver", "daqp", "leak_um") < 1e-6
    ours_um = figure("solver", "solve_fast", "slip_error_um")
    assert figure("solver", "daqp", "slip_error_um") == pytest.approx(ours_um, abs=1e-6)


def test_nothing_fails_at_the_ends_of_the_solver_s_range() -> None:
    for row in table("situations").rows:
        assert row.figures["failures_count"] == row.figures["limits_broken_count"] == 0, row.name
        assert row.figures["leak_um"] < 1e-12, row.name
        assert row.figures["wire_leak_um"] < 1e-3, row.name
    assert figure("situations", "condition 1", "digits_one_still_count") >= 14
    # the rows' own digits less the condition
    assert figure("situations", "condition 1e+08", "digits_one_still_count") >= 7


def test_no_error_adds_up_over_a_long_walk() -> None:
    for row in table("walk").rows:
        assert row.figures["drift_um"] < stability.NOTHING_UM, row.name
    assert figure("walk", "solve_fast, one still", "drift_um") == 0.0


def test_contacts_get_the_same_in_each_lap_of_a_walk_without_a_jump_or_a_broken_limit() -> None:
    for row in table("contacts_walk").rows:
        assert row.figures["drift_um"] < 0.1, row.name  # of 1 um: two optima may be equally good
        assert row.figures["jump_um"] < 1.0, row.name  # a flip would be 8 um
        assert row.figures["beyond_um"] < 1e-12, row.name


def test_friction_as_asked_holds_limits_and_forgets_rough_laps() -> None:
    for row in table("felt_walk").rows:
        assert row.figures["failures_count"] == row.figures["limits_broken_count"] == 0, row.name
        assert row.figures["past_slew_count"] == 0, row.name
        assert abs(row.figures["drift_jnd"]) < 0.3, row.name  # of several optima that are equally good


def test_outside_references_that_are_missing_are_skipped_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (solver, stability):
        monkeypatch.setattr(module, "optional", lambda _: None)
    for found in (
        solver.run(problems=5, repeats=1, timed=1),
        stability.situations(1),
    ):
        assert found.skipped
        assert not [row.name for row in found.rows if row.name.startswith(tuple(found.skipped))]


def test_one_call_from_a_millimetre_away_is_near_the_best_that_a_general_minimiser_finds() -> None:
    for fingers, modes in contacts.SIZES:
        name = f"{fingers} contacts, {modes} modes"
        assert figure("contacts", name, "felt_frac") < 1.1 * figure("contacts", name, "least_frac") + 0.01


def test_more_importance_of_the_still_contact_buys_contrast_with_slip() -> None:
    figures = [row.figures for row in table("contacts_frontier").rows]
    slip_um, contrast = ([one[name] for one in figures] for name in ("contact_slip_um", "contrast"))
    assert slip_um == sorted(slip_um, reverse=True)
    assert contrast == sorted(contrast)
    ours = contacts.IMPORTANCES.index(STILL_IMPORTANCE)
    assert 0.75 < slip_um[ours] < 0.85
    assert 14.0 < contrast[ours] < 20.0


def test_all_fingers_feel_what_was_asked_about_as_often_as_a_general_minimiser_gives() -> None:
    for fingers, modes in felt.SIZES:
        name = f"{fingers} contacts, {modes} modes"
        ours, bound = figure("felt", name, "felt_frac"), figure("felt", f"{name}, bound", "felt_frac")
        assert ours >= bound - 0.34, name  # two of six problems
        assert ours >= figure("felt", f"{name}, by contrast", "felt_frac")
    assert figure("felt", "2 contacts, 8 modes", "felt_frac") > 0.6
