"""Tables and run times of the bench, on made-up figures."""

from __future__ import annotations

import json
import math

import pytest

from hapticd.bench.tables import Table, number, plain, render
from hapticd.bench.timing import least_us

TABLE = Table(
    "made-up",
    "a made-up comparison",
    {
        "ours": {"time_us": 2.0, "leak_um": 0.01},
        "other": {"time_us": 8.0, "leak_um": 0.08, "limits_broken_count": 3},
        "exact": {"time_us": 3.0, "leak_um": 0.0, "slip_error_um": math.nan},
    },
    ("time_us", "leak_um"),
    ("oracle: skipped, it is not installed",),
)


def test_ratios_are_to_the_first_row_and_what_is_not_finite_is_left_out() -> None:
    assert math.isnan(TABLE.ratio("exact", "leak_um"))
    assert math.isnan(TABLE.ratio("other", "limits_broken_count"))
    with pytest.raises(KeyError):
        TABLE.figure("none", "time_us")
    written = json.loads(json.dumps(plain(TABLE), allow_nan=False))
    assert written["default"] == "ours"
    assert written["alternatives"]["other"]["limits_broken_count"] == 3
    assert written["alternatives"]["other"]["time_us_ratio"] == 4.0
    assert "slip_error_um" not in written["alternatives"]["exact"]


def test_the_text_has_a_column_for_each_figure_with_its_ratio_and_the_notes() -> None:
    title, head, ours, other, exact, note = render(TABLE).splitlines()
    assert title == "a made-up comparison"
    assert head.split() == ["time_us", "leak_um", "limits_broken_count", "slip_error_um"]
    assert ours.split() == ["ours", "2", "x1", "0.0100", "x1", "-", "-"]
    assert other.split() == ["other", "8", "x4", "0.0800", "x8", "3", "-"]
    assert exact.split() == ["exact", "3", "x1.50", "0", "-", "-"]
    assert note == "  oracle: skipped, it is not installed"


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.99999, "1.00"), (1234.0, "1234"), (12.34, "12.3"), (0.012345, "0.0123"), (4e-17, "4e-17")],
)
def test_numbers_have_three_digits_where_a_person_reads_them(value: float, text: str) -> None:
    assert number(value) == text


def test_alternatives_are_timed_in_turns_per_operation() -> None:
    calls: list[str] = []
    times_us = least_us({"a": (lambda: calls.append("a"), 1), "b": (lambda: calls.append("b"), 10)}, repeats=3)
    assert calls == ["a", "b"] * 3
    assert [*times_us] == ["a", "b"]
    assert all(time_us > 0.0 for time_us in times_us.values())
