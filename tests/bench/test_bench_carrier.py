"""The bench of the signal chain on small sizes: the orderings that its choices rest on."""

from __future__ import annotations

import json
import math

import pytest

from hapticd.bench import carrier
from hapticd.bench.tables import UNITS, Table, plain, render


@pytest.fixture(scope="module")
def tables() -> tuple[Table, Table]:
    return carrier.run(ticks=20, repeats=1)


def figure(table: Table, alternative: str, name: str) -> float:
    return table.row(alternative).figures[name]


def test_every_figure_is_a_finite_number_with_its_unit_in_the_name(tables: tuple[Table, Table]) -> None:
    for table in tables:
        told = json.loads(json.dumps(plain(table), allow_nan=False))
        for figures in told["alternatives"].values():
            assert all(math.isfinite(value) and key.endswith((*UNITS, "_ratio")) for key, value in figures.items())
        assert table.default in render(table)


def test_the_firmware_demodulates_as_well_as_float64_least_squares(tables: tuple[Table, Table]) -> None:
    for name in ("mean_error_frac", "ripple_um"):
        best = figure(tables[0], "numpy.linalg.lstsq", name)
        assert figure(tables[0], carrier.FIRMWARE, name) == pytest.approx(best, rel=0.15)


@pytest.mark.parametrize("shortcut", ["Gram matrix of one tick", "mean of products", "same, offset removed"])
def test_every_shortcut_costs_half_a_per_cent_and_more(tables: tuple[Table, Table], shortcut: str) -> None:
    assert figure(tables[0], shortcut, "mean_error_frac") > 0.005


def test_rounding_the_phase_is_worth_a_table_of_twice_the_size(tables: tuple[Table, Table]) -> None:
    error = {row.name: row.figures["mean_error_frac"] for row in tables[1].rows}
    assert error["1024 rounded"] == pytest.approx(error["1024 truncated"] / 2, rel=0.05)
    assert error[carrier.FIRMWARE_TABLE] == pytest.approx(error["4096 rounded"] / 2, rel=0.05)
