"""A person's friction curve from comparisons, over simulated observers of all kinds."""

from __future__ import annotations

import numpy as np

from hapticd.bench import persons
from hapticd.design.person import CHECK_MOST, CHECK_TRIALS, calibrated, checked
from hapticd.sim.observer import KINDS, REFERENCE, SimulatedObserver

OBSERVERS = 10  # of each kind


def test_the_curve_is_within_five_percent_and_its_interval_honest() -> None:
    (table,) = persons.run(OBSERVERS)
    rows = list(table.rows.values())
    assert [*table.rows] == [*KINDS]
    assert np.mean([row["error_percent"] ** 2 for row in rows]) <= 5.0**2
    assert np.mean([row["covered_percent"] for row in rows]) >= 90.0
    for row in rows:
        assert row["error_percent"] < 0.4 * row["before_percent"]
        assert row["time_min"] <= 3.0


def test_ten_comparisons_accept_a_curve_and_refuse_one_that_is_off_by_a_fifth() -> None:
    refused = dict.fromkeys((1.0, 1.2, 1.0 / 1.2), 0)
    for seed in range(30):
        observer = SimulatedObserver(KINDS["usual"], seed)
        found = calibrated(observer.compare, REFERENCE)
        for off in refused:
            count = checked(observer.compare, off * found.decay_um, REFERENCE)
            refused[off] += abs(count - CHECK_TRIALS // 2) > CHECK_MOST
    assert refused.pop(1.0) <= 6
    assert min(refused.values()) >= 24
