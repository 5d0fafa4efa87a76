"""Tables: units in the names, ratios to the default, plain finite JSON, and text."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from hapticd.bench.plot import draw
from hapticd.bench.tables import Table, finite_rows, number, plain, render
from hapticd.bench.timing import compare, least, least_by_pass

SKIPPED = {"oracle": "it is not installed"}


def table(**changes: object) -> Table:
    rows = finite_rows(
        [
            ("ours", {"time_us": 2.0, "time_spread_us": 0.5, "leak_um": 0.01, "limits_broken_count": 0}),
            ("other", {"time_us": 8.0, "time_spread_us": 0.25, "leak_um": 0.08, "limits_broken_count": 3}),
            ("exact", {"time_us": 3.0, "leak_um": 1e-17, "slip_error_um": math.nan}),
        ]
    )
    made = Table(
        name="made-up",
        title="a made-up comparison",
        default="ours",
        rows=rows,
        compared=("time_us", "leak_um"),
        time="time_us",
        error="leak_um",
        floor=1e-9,
        skipped=SKIPPED,
    )
    return replace(made, **changes)


def test_ratios_are_to_the_default_and_nothing_has_none() -> None:
    made = table()
    assert made.ratios(made.row("other")) == pytest.approx({"time_ratio": 4.0, "leak_ratio": 8.0})
    assert made.ratios(made.row("ours")) == {"time_ratio": 1.0, "leak_ratio": 1.0}
    assert made.ratios(made.row("exact")) == {"time_ratio": 1.5}
    with pytest.raises(KeyError):
        made.row("none")


def test_the_json_is_plain_and_leaves_out_what_is_not_finite() -> None:
    plain_table = json.loads(json.dumps(plain(table()), allow_nan=False))
    assert plain_table["default"] == "ours"
    assert plain_table["skipped"] == SKIPPED
    assert plain_table["alternatives"]["other"]["limits_broken_count"] == 3
    assert plain_table["alternatives"]["other"]["time_ratio"] == 4.0
    assert "slip_error_um" not in plain_table["alternatives"]["exact"]


def test_the_text_marks_the_default_and_names_what_is_skipped() -> None:
    lines = render(table()).splitlines()
    assert lines[0] == "a made-up comparison"
    assert [line[:2] for line in lines if "x" in line and "(" in line and "spread" not in line] == ["* ", "  "]
    assert any("time" in line and "leak" in line for line in lines)
    assert any("x8.00" in line for line in lines)
    assert "  oracle: skipped, it is not installed" in lines
    exact = next(line for line in lines if "exact" in line)
    assert exact.split()[1:] == ["3.00", "x1.50", "0", "-"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.99999, "1.00"), (1234.0, "1234"), (12.34, "12.3"), (0.012345, "0.0123"), (4e-17, "4e-17")],
)
def test_numbers_have_three_digits_where_a_person_reads_them(value: float, text: str) -> None:
    assert number(value) == text


def test_alternatives_are_timed_per_operation_and_by_their_least() -> None:
    calls: list[str] = []
    times = compare({"a": (lambda: calls.append("a"), 1), "b": (lambda: calls.append("b"), 10)}, repeats=3)
    assert calls == ["a", "b"] * 3
    assert all(timing.best_us > 0.0 and timing.spread_us >= 0.0 for timing in times.values())
    assert least([5.0, 3.0, 4.0]) == (3.0, 2.0)
    assert least_by_pass([[1.0, 6.0], [3.0, 4.0]]) == (2.5, 1.0)


def test_every_kind_of_panel_can_be_drawn(tmp_path: Path) -> None:
    bars = finite_rows([("whole", {"hot_us": 9.0, "paced_us": 20.0}), ("part", {"hot_us": 4.0})])
    tables = [table(), table(default="whole", rows=bars, time="", error="", compared=("hot_us",))]
    picture = tmp_path / "bench.png"
    draw(tables, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
