"""The ledger: histograms that know their error, and frames that are booked once."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.board.ledger import LATE_NS, LEDGER_LENGTH, PAUSE_NS, Histogram, Ledger, LedgerLine, LoopTiming

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


@given(st.lists(spans))
def test_every_span_is_in_one_bucket_and_buckets_do_not_overlap(values: list[int]) -> None:
    histogram = filled(values)
    buckets = histogram.buckets()
    assert sum(count for _, _, count in buckets) == histogram.count == len(values)
    assert all(before[1] <= after[0] for before, after in pairwise(buckets))
    for value in values:
        inside = min(max(value, 0), 2**40 - 1)
        assert any(from_ns <= inside < below_ns for from_ns, below_ns, _ in buckets)


@given(st.lists(spans, min_size=1))
def test_extremes_are_exact(values: list[int]) -> None:
    histogram = filled(values)
    assert (histogram.shortest_ns, histogram.longest_ns) == (min(values), max(values))


def test_an_empty_histogram_has_nothing_to_say() -> None:
    histogram = filled([5 * MS])
    histogram.clear()
    assert (histogram.count, histogram.percentile_ns(50), histogram.buckets()) == (0, 0, [])


def line(seq: int, late_ns: int = 0) -> LedgerLine:
    return LedgerLine(seq, 0, 10 * MS, 16 * MS + late_ns, 10 * MS, 16 * MS, 5 * MS, late_ns)


def test_the_newest_lines_are_kept_and_all_are_counted() -> None:
    ledger = Ledger()
    for seq in range(LEDGER_LENGTH + 10):
        ledger.book(line(seq))
    assert (len(ledger), ledger[0].seq, ledger[-1].seq) == (LEDGER_LENGTH, 10, LEDGER_LENGTH + 9)
    assert [each.seq for each in ledger[:2]] == [10, 11]
    assert ledger.age.count == ledger.link.count == LEDGER_LENGTH + 10
    assert ledger.age.percentile_ns(50) == pytest.approx(10 * MS, rel=0.032)


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


def test_a_frame_is_on_the_wire_some_time_after_its_report_was_read() -> None:
    timing = LoopTiming()
    timing.wrote(1000, 181_000)
    assert (timing.wire.count, timing.wire.longest_ns) == (1, 180_000)


@pytest.mark.parametrize(("span_ns", "counted"), [(PAUSE_NS, 0), (PAUSE_NS + 1, 1)])
def test_a_pause_is_counted_beyond_a_millisecond_and_each_is_kept(span_ns: int, counted: int) -> None:
    timing = LoopTiming()
    timing.paused(span_ns)
    assert timing.pauses == counted
    assert timing.pause.longest_ns == span_ns
