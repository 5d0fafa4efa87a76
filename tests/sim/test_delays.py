"""What shorter delays gain."""

from __future__ import annotations

import pytest

from hapticd.sim import delays


@pytest.mark.long
def test_a_faster_line_and_faster_reports_each_lower_the_leak_and_both_lower_it_most() -> None:
    usual, line, reports, both = delays.measure(seeds=(1, 2, 3)).values()
    assert line.horizon_ms == pytest.approx(usual.horizon_ms - 3.5, abs=0.2)
    assert line.leak_um < 0.9 * usual.leak_um
    assert reports.leak_um < 0.95 * usual.leak_um
    assert both.leak_um < 0.8 * usual.leak_um


def test_delays_are_those_of_the_way_of_a_touch() -> None:
    found = delays.measure(seeds=(1,), seconds=1.0)
    assert set(found) == set(delays.SHORTER)
    assert found["both"].horizon_ms < found[delays.USUAL].horizon_ms - 3.0
