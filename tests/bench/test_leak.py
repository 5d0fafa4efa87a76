"""The leak benches on small sizes: alternatives of the loop, two slippery fingers, contacts, the leak budget."""

from __future__ import annotations

import pytest

from hapticd.bench import felt_loop, leak, leak_budget
from hapticd.bench.tables import Table
from hapticd.sim.plate.glasses import FINGERTIP

pytestmark = pytest.mark.long

CHANGES = ("predictor hold", "a single knot", "the paper's scheme")


def figures(table: Table, name: str) -> dict[str, float]:
    return {row.name: row.figures[name] for row in table.rows}


def test_ours_leaks_less_than_the_paper_s_scheme_and_more_than_perfect_knowledge() -> None:
    leaks_um = figures(leak.run(seeds=(1,), seconds=2.0, names=CHANGES), "leak_um")
    assert set(leaks_um) == {leak.DEFAULT, *CHANGES, leak.PERFECT}
    assert leaks_um[leak.PERFECT] < leak.NOTHING_UM < leaks_um[leak.DEFAULT]
    assert leaks_um["predictor hold"] > 3 * leaks_um[leak.DEFAULT]
    assert leaks_um[leak.PAPER] > 4 * leaks_um[leak.DEFAULT]
    assert leaks_um["a single knot"] > leaks_um[leak.DEFAULT]


def test_every_alternative_of_the_leak_is_another_run() -> None:
    alternatives = leak.alternatives()
    assert len(set(alternatives.values())) == len(alternatives)


def test_two_slippery_fingers_dip_less_with_phase_continuation_than_with_sign_changes() -> None:
    table = leak.both_slip(seeds=(1,), seconds=4.0)
    for name in ("slip_error_um", "dip_frac", "step_um"):
        of = figures(table, name)
        assert of[leak.DEFAULT] < of[leak.SIGNS_ALONE]
    slip_error_um = figures(table, "slip_error_um")
    assert slip_error_um[leak.SIGNS_ALONE] < slip_error_um[leak.PAPER]


def test_contacts_differ_by_more_the_more_modes_and_near_what_perfect_knowledge_gives() -> None:
    table = leak.contact(seeds=(1,), seconds=2.0)
    contrast, felt = figures(table, "contrast"), figures(table, "felt_frac")
    named = [f"{plate} plate, {modes} modes" for plate, modes in leak.CONTACT_PLATES]
    assert contrast[named[0]] < 2.0 < contrast[named[1]] < contrast[named[2]]
    assert felt[named[0]] < 0.02 < felt[named[2]] < felt[named[3]] < felt[named[4]]
    for name in named[2:4]:
        by_contrast = f"{name}, {leak.BY_CONTRAST}"
        assert felt[name] > 2.0 * felt[by_contrast]
        assert contrast[name] < contrast[by_contrast]
        for one in (name, by_contrast):
            assert contrast[one] > 0.8 * contrast[f"{one}, {leak.PERFECT}"]
            assert felt[one] <= felt[f"{one}, {leak.PERFECT}"] + 0.02


def test_a_contact_of_another_form_than_is_believed_feels_other_friction() -> None:
    felt = figures(felt_loop.conditions(seeds=(1,), seconds=2.0), "felt_frac")
    assert len(felt) == len(felt_loop.SPEEDS_MM_S) + len(felt_loop.RADII_MM) + 1
    assert felt["discs of 7 mm"] <= felt["discs of 6 mm"] < felt["10 cm/s"]
    assert all(felt[name] > 0.0 for name in ("20 cm/s", "40 cm/s", "discs of 4 mm", "ellipses of 8 x 11 mm"))


def test_more_fingers_are_as_asked_no_more_often_than_could_be_at_each_instant() -> None:
    two_of_three = felt_loop.fingers(names=("two-of-three",), plates=((FINGERTIP, 6),), seeds=(1,), seconds=2.0)
    felt, bound = (figures(two_of_three, name) for name in ("felt_frac", "bound_frac"))
    (name,) = felt
    assert 0.0 < felt[name] <= bound[name] + 0.05


@pytest.fixture(scope="module")
def budget() -> Table:
    return leak_budget.run(seeds=(1,), seconds=3.0)


def test_each_part_made_perfect_leaks_less(budget: Table) -> None:
    leaks_um = figures(budget, "leak_um")
    ours_um = leaks_um[leak.DEFAULT]
    assert len(leaks_um) == len(budget.rows) == 2 * 2 * 3
    assert leaks_um["true positions"] < 0.8 * ours_um
    assert leaks_um["true parasitic modes + loop"] < leaks_um["true parasitic modes"] < ours_um
    assert leaks_um["true positions + map"] < leaks_um["true positions"]
    assert leaks_um["true positions + map + parasitic modes + loop"] < 0.15 * ours_um


def test_the_true_path_errs_by_the_polyline_s_chord_alone(budget: Table) -> None:
    errors_mm = figures(budget, "position_error_mm")
    assert errors_mm["true positions"] < 0.02
    assert errors_mm[leak.DEFAULT] > 0.08
