"""At singular positions the reference steps far less than by the paper's formula, at worst too."""

from __future__ import annotations

import pytest

from hapticd.bench import singular
from hapticd.bench.tables import Table


@pytest.fixture(scope="module")
def table() -> Table:
    return singular.run(strokes=12)


def test_the_largest_step_is_a_third_of_the_paper_s_at_most(table: Table) -> None:
    ours = table.row(singular.DEFAULT).figures
    assert table.row(singular.PAPER).figures["largest_step_um"] == pytest.approx(8.0)  # from one limit to the other
    assert ours["of_paper"] > 3.0
    assert ours["usual_step_um"] < ours["largest_step_um"] <= ours["anywhere_um"] < 8.0 / 3.0


def test_derating_costs_the_still_finger_less_and_the_slipping_one_little(table: Table) -> None:
    ours, riding = (table.row(name).figures for name in (singular.DEFAULT, singular.NO_DERATING))
    assert ours["price_um"] < 0.85 * riding["price_um"]
    assert 0.93 * riding["share_frac"] < ours["share_frac"] < riding["share_frac"]


def test_the_still_finger_gets_nothing_at_any_knot(table: Table) -> None:
    assert all(row.figures["leak_um"] < 1e-12 for row in table.rows)
