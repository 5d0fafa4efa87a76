"""The ledger: histograms that know their error, and frames that are booked once."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.board.ledger import LATE_NS, Histogram, Ledger
from hapticd.daemon.loop_timing import LoopTiming
from hapticd.values import LedgerLine

MS = 1_000_000
spans = st.integers(-(2**62), 2**62) | st.integers(-10, 5000) | st.integers(0, 2**40).map(lambda span: span | 1)


def filled(values: list[int]) -> Histogram:
    histogram = Histogram()
    for value in values:
        histogram.add(value)
    return histogram


@given(st.lists(spans, min_size=1), st.floats(0.0, 100.0))
def test_a_percentile_is_that_of_the_sorted_spans_to_within_the_bucket_s_half_width(
    values: list[int], percent: float
) -> None:
    ordered = sorted(min(max(value, 0), 2**40) for value in values)
    true_ns = ordered[max(1, math.ceil(len(values) * percent / 100)) - 1]
    told_ns = min(max(filled(values).percentile_ns(percent), 0), 2**40)
    assert abs(told_ns - true_ns) <= 1 + true_ns / 31


def line(seq: int, late_ns: int = 0) -> LedgerLine:
    return LedgerLine(seq, 0, 10 * MS, 16 * MS + late_ns, 10 * MS, 16 * MS, 5 * MS, late_ns)


@pytest.mark.parametrize(("late_ns", "counted"), [(-3 * MS, 0), (LATE_NS, 0), (LATE_NS + 1, 1)])
def test_a_frame_is_late_beyond_a_millisecond(late_ns: int, counted: int) -> None:
    ledger = Ledger()
    ledger.book(line(1, late_ns))
    assert ledger.late_frames == counted
    assert ledger.late.longest_ns == late_ns


def test_the_loop_s_part_is_from_reading_to_writing() -> None:
    timing = LoopTiming()
    timing.passed(1000, 1020, 1320, reports=3, age_ns=10_020)
    timing.passed(2000, 2010, 2020, reports=1, age_ns=None)
    timing.ticked(70, missed=2)
    assert (timing.read_age.count, timing.read_age.longest_ns) == (1, 10_000)
    assert (timing.wait.longest_ns, timing.compute.longest_ns, timing.tick_late.longest_ns) == (20, 300, 70)
    assert (timing.joined_reports, timing.missed_ticks) == (2, 2)
