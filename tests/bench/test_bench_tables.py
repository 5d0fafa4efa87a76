"""Tables and run times of the bench, on made-up figures."""

from __future__ import annotations

import json
import math

import pytest

from hapticd.bench.tables import Table, plain, render
from hapticd.bench.timing import least_us

TABLE = Table(
    "made-up",
    "a made-up comparison",
    {
        "ours": {"time_us": 2.0, "leak_um": 0.01},
        "other": {"time_us": 8.0, "leak_um": 0.08, "limits_broken_count": 3},
        "exact": {"time_us": 3.0, "leak_um": 0.0, "slip_error_um": math.nan},
    },
    ("oracle: skipped, it is not installed",),
)


def test_what_is_not_finite_is_left_out_of_json_and_a_dash_in_text() -> None:
    with pytest.raises(KeyError):
        TABLE.figure("none", "time_us")
    written = json.loads(json.dumps(plain(TABLE), allow_nan=False))
    assert written["default"] == "ours"
    assert written["alternatives"]["other"]["limits_broken_count"] == 3
    assert "slip_error_um" not in written["alternatives"]["exact"]
    assert render(TABLE).splitlines()[4].split()[-1] == "-"


def test_alternatives_are_timed_in_turns_per_operation() -> None:
    calls: list[str] = []
    times_us = least_us({"a": (lambda: calls.append("a"), 1), "b": (lambda: calls.append("b"), 10)}, repeats=3)
    assert calls == ["a", "b"] * 3
    assert [*times_us] == ["a", "b"]
    assert all(time_us > 0.0 for time_us in times_us.values())
