"""Who leaks what remains: each perfect part lowers it, and with all three next to nothing is left."""

from __future__ import annotations

import pytest

from hapticd.bench import leak_budget as remains
from hapticd.bench.tables import Table


@pytest.fixture(scope="module")
def table() -> Table:
    return remains.run(seeds=(1,), seconds=3.0)


def leak_um(table: Table, name: str) -> float:
    return table.row(name).figures["leak_um"]


def test_every_set_of_perfect_parts_has_its_row(table: Table) -> None:
    assert table.rows[0].name == remains.DEFAULT
    assert len({row.name for row in table.rows}) == 2 * 2 * 3


def test_each_part_made_perfect_leaks_less(table: Table) -> None:
    ours_um = leak_um(table, remains.DEFAULT)
    assert leak_um(table, "true positions") < 0.8 * ours_um
    assert leak_um(table, "true neighbours + loop") < leak_um(table, "true neighbours") < ours_um
    assert leak_um(table, "true positions + map") < leak_um(table, "true positions")
    assert leak_um(table, "true positions + map + neighbours + loop") < 0.15 * ours_um


def test_who_knows_the_path_is_off_by_the_polyline_s_chord_alone(table: Table) -> None:
    assert table.row("true positions").figures["position_error_mm"] < 0.02
    assert table.row(remains.DEFAULT).figures["position_error_mm"] > 0.08
