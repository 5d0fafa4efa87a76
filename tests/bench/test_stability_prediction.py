"""The predictors' numerics hold on the sizes that the bench tells, and who is missing is named."""

from __future__ import annotations

import math

import pytest

from hapticd.bench import stability_prediction as stability
from hapticd.bench.tables import UNITS


def test_no_origin_of_time_changes_a_bit() -> None:
    assert [figures["changed_count"] for _, figures in stability.origins()] == [0] * (len(stability.ORIGINS_NS) - 1)


def test_no_interval_throws_the_finger() -> None:
    thrown_mm = {name: figures["thrown_mm"] for name, figures in stability.intervals()}
    assert thrown_mm["prediction, interval 0 ns"] == 0.0
    assert thrown_mm["prediction, interval 10 s"] == 0.0
    assert 0.0 < thrown_mm["prediction, interval 1 us"] < 2.0


def test_a_long_touch_ends_as_well_as_it_began(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability, "LONG_RUN_SAMPLES", 20_000)
    ((_, figures),) = stability.long_run()
    assert figures["late_rms_mm"] == pytest.approx(figures["early_rms_mm"], rel=0.1)
    assert figures["late_rms_mm"] < 0.2


def test_gains_have_twelve_correct_digits_and_settle() -> None:
    digits = [figures["digits_count"] for _, figures in stability.gain_digits(pytest.importorskip("mpmath"))]
    assert min(digits) >= 12.0
    off = {
        name: figures["off_steady_frac"]
        for name, figures in stability.steady_gains(pytest.importorskip("scipy.linalg"))
    }
    assert all(0.0 <= value < 0.02 for value in off.values())


def test_all_rows_are_told_with_units_and_missing_references_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability, "LONG_RUN_SAMPLES", 2_000)
    monkeypatch.setattr(stability, "optional", lambda _: None)
    rows, skipped = stability.run()
    assert len(skipped) == 2
    assert len({name for name, _ in rows}) == len(rows) > 5
    for _, figures in rows:
        assert all(math.isfinite(value) and key.endswith(tuple(UNITS)) for key, value in figures.items())
