"""Tables: units in the names, ratios to the default, plain finite JSON, and text."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hapticd.bench.plot import draw
from hapticd.bench.tables import Table, finite_rows, number, plain, ratio_name, render, stem, unit
from hapticd.bench.timing import compare, least, least_by_pass, optional
from hapticd.files import plotting

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


def test_a_figure_s_unit_stands_at_the_end_of_its_name() -> None:
    assert [unit(name) for name in ("time_us", "leak_um", "limits_broken_count")] == ["us", "um", ""]
    assert stem("leak_um") == "leak"
    assert ratio_name("time_us") == "time_ratio"


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


def test_a_library_may_be_missing() -> None:
    assert optional("hapticd_has_no_such_module") is None
    assert optional("math") is math


def test_every_kind_of_panel_can_be_drawn(tmp_path: Path) -> None:
    bars = finite_rows([("whole", {"hot_us": 9.0, "paced_us": 20.0}), ("part", {"hot_us": 4.0})])
    tables = [table(), table(default="whole", rows=bars, time="", error="", compared=("hot_us",))]
    picture = tmp_path / "bench.png"
    draw(tables, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_panel_of_nearly_equal_times_has_labelled_ticks_and_shows_rows_without_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    figures: list[Any] = []
    monkeypatch.setattr(plotting, "save", lambda figure, _: figures.append(figure))
    rows = finite_rows(
        [
            ("exact", {"time_us": 0.83, "leak_um": 4.1}),
            ("other", {"time_us": 0.81, "leak_um": 4.2}),
            ("bound", {"leak_um": 3.4}),
        ]
    )
    draw([table(rows=rows)], Path("bench.png"))
    (axis,) = figures[0].axes
    figures[0].draw_without_rendering()
    for low, high, scaled in ((*axis.get_xlim(), axis.xaxis), (*axis.get_ylim(), axis.yaxis)):
        shown = [place for place in scaled.get_majorticklocs() if low <= place <= high]
        assert len(shown) >= 3
    assert [float(line.get_ydata()[0]) for line in axis.get_lines()] == [4.1, 4.2, 3.4]
