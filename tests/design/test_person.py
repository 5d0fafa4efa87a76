"""A person's friction curve from comparisons, over simulated observers of all kinds."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.bench import persons
from hapticd.design.person import CHECK_MOST, CHECK_TRIALS, calibrated, checked
from hapticd.sim.observer import KINDS, REFERENCE, SimulatedObserver

OBSERVERS = 20  # of each kind


def test_the_curve_is_within_five_percent_and_its_interval_honest() -> None:
    (table,) = persons.run(OBSERVERS)
    rows = list(table.rows.values())
    assert [*table.rows] == [*KINDS]
    assert np.mean([row["error_percent"] ** 2 for row in rows]) <= 5.0**2
    assert np.mean([row["covered_percent"] for row in rows]) >= 90.0
    for row in rows:
        assert row["error_percent"] < 0.4 * row["before_percent"]
        assert row["time_min"] <= 3.0


@pytest.mark.parametrize(("off", "least", "most"), [(1.0, 0, 8), (1.2, 32, 40), (1.0 / 1.2, 32, 40)])
def test_ten_comparisons_refuse_a_curve_that_is_off_by_a_fifth(off: float, least: int, most: int) -> None:
    refused = 0
    for seed in range(40):
        observer = SimulatedObserver(KINDS["usual"], seed)
        found = calibrated(observer.compare, REFERENCE)
        count = checked(observer.compare, off * found.decay_um, REFERENCE)
        refused += abs(count - CHECK_TRIALS // 2) > CHECK_MOST
    assert least <= refused <= most
