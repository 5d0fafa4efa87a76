"""Latency ledger: counters and histograms of each reference frame and of each part of the touch path.

Pure. `Ledger` keeps the last frames line by line and all frames as histograms; `LoopTiming` is the same for the event
loop that carries the touch. A histogram costs one shift and one addition a value, and its memory does not grow.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from ...board_values import BoardStatus
from ...values import LedgerLine
from .link import BoardClock, Flight, LinkLatency

LEDGER_LENGTH: Final = 512
PAUSE_NS: Final = 1_000_000  # of Python's collector: longer ones are counted
LATE_NS: Final = 1_000_000  # a frame that takes effect later than planned by more than the clocks' error
_SUB_BITS: Final = 4  # sixteen buckets an octave: a bucket's middle is within 3.2 % of what fell into it
_LONGEST_NS: Final = (1 << 40) - 1  # 18 minutes: all that is longer is one bucket
_FULL: Final = 1 << _SUB_BITS
_BUCKETS: Final = ((40 - _SUB_BITS) << _SUB_BITS) + _FULL


class Histogram:
    """Spans of time in buckets whose width is a sixteenth of their octave; below 32 ns each has its own."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Reset."""
        self.count = 0
        self.longest_ns = self.shortest_ns = 0
        self._counts = [0] * _BUCKETS

    def add(self, span_ns: int) -> None:
        """Count one span; a negative one (a clock's error) counts as 0, and shows in `shortest_ns`."""
        if self.count == 0:
            self.longest_ns = self.shortest_ns = span_ns
        elif span_ns > self.longest_ns:
            self.longest_ns = span_ns
        elif span_ns < self.shortest_ns:
            self.shortest_ns = span_ns
        self.count += 1
        self._counts[_bucket(span_ns)] += 1

    def percentile_ns(self, percent: float) -> int:
        """The span that `percent` of all do not exceed, to within 3.2 %. 0 where nothing was counted."""
        rank = max(1, -(-self.count * percent // 100))
        seen = 0
        for bucket, count in enumerate(self._counts):
            seen += count
            if count and seen >= rank:
                low_ns, high_ns = _edges_ns(bucket)
                return min(max((low_ns + high_ns) // 2, self.shortest_ns), self.longest_ns)
        return 0

    def buckets(self) -> list[tuple[int, int, int]]:
        """(from_ns, below_ns, count) of the buckets that hold something, ascending."""
        return [(*_edges_ns(bucket), count) for bucket, count in enumerate(self._counts) if count]


def _bucket(span_ns: int) -> int:
    if span_ns < 2 * _FULL:
        return span_ns if span_ns > 0 else 0
    span_ns = min(span_ns, _LONGEST_NS)
    octave = span_ns.bit_length() - _SUB_BITS - 1
    return (octave << _SUB_BITS) + (span_ns >> octave)


def _edges_ns(bucket: int) -> tuple[int, int]:
    """The spans of a bucket: from the first up to, but not including, the second."""
    octave = max((bucket >> _SUB_BITS) - 1, 0)
    low = bucket - (octave << _SUB_BITS)
    return low << octave, (low + 1) << octave


class Ledger:
    """The newest frames that the board applied, oldest first, and histograms of all since the start."""

    def __init__(self) -> None:
        self.age, self.horizon, self.link, self.late = Histogram(), Histogram(), Histogram(), Histogram()
        self.late_frames = 0
        self.lines: deque[LedgerLine] = deque(maxlen=LEDGER_LENGTH)

    def applied(
        self, flight: Flight, status: BoardStatus, clock: BoardClock, latency: LinkLatency, t_now_ns: int
    ) -> LedgerLine | None:
        """Add a frame that a status acknowledges as applied; return its line, None for a zero frame."""
        t_sent_ns, t_apply_ns, tick = flight
        link_ns = clock.to_host_ns(status.t_received_us, near=t_now_ns) - t_sent_ns
        t_applied_ns = clock.to_host_ns(status.t_applied_us, near=t_now_ns)
        latency.update(link_ns)
        if not tick.points:
            return None  # a zero frame is made from no sample
        t_sample_ns = tick.t_now_ns - tick.age_ns
        ages = tick.age_ns, tick.horizon_ns, link_ns, t_applied_ns - t_apply_ns
        line = LedgerLine(status.seq, t_sample_ns, t_sent_ns, t_applied_ns, *ages)
        self.book(line)
        return line

    def book(self, line: LedgerLine) -> None:
        """Add a frame that the board applied."""
        self.lines.append(line)
        self.age.add(line.age_ns)
        self.horizon.add(line.horizon_ns)
        self.link.add(line.link_ns)
        self.late.add(line.late_ns)
        self.late_frames += line.late_ns > LATE_NS


@dataclass(slots=True)
class LoopTiming:
    """The event loop's part: a report's age when it was read, from its reading to its pass, the pass with all that
    follows it, from reading to the written frame, the timer, and the pauses of Python's collector. The age is only
    known while a finger is down.

    `joined_reports` came to a pass together with a newer one; `missed_ticks` are timer ticks that were due while the
    loop was busy, and are skipped, not made up for; `pauses` are those of the collector above PAUSE_NS; `overruns` are
    passes that took more than `core.budget.OVERRUN_NS` of the processor, `throttled` the sleeps of a loop that was too
    busy.
    """

    read_age: Histogram = field(default_factory=Histogram)
    wait: Histogram = field(default_factory=Histogram)
    compute: Histogram = field(default_factory=Histogram)
    wire: Histogram = field(default_factory=Histogram)
    tick_late: Histogram = field(default_factory=Histogram)
    pause: Histogram = field(default_factory=Histogram)
    joined_reports: int = 0
    missed_ticks: int = 0
    pauses: int = 0
    overruns: int = 0
    throttled: int = 0
    last_late_ns: int = 0  # of the newest tick

    def passed(self, t_read_ns: int, t_begin_ns: int, t_end_ns: int, reports: int, age_ns: int | None) -> None:
        """A batch was read, its newest report at `t_read_ns`, and a pass made of it; `age_ns` is that report's age when
        the pass began, None where no finger was down."""
        if age_ns is not None:
            self.read_age.add(age_ns - (t_begin_ns - t_read_ns))
        self.wait.add(t_begin_ns - t_read_ns)
        self.compute.add(t_end_ns - t_begin_ns)
        self.joined_reports += reports - 1

    def ticked(self, late_ns: int, missed: int) -> None:
        """The timer fired, `late_ns` after it was due, and skipped `missed` ticks."""
        self.tick_late.add(late_ns)
        self.last_late_ns = late_ns
        self.missed_ticks += missed

    def wrote(self, t_read_ns: int, t_written_ns: int) -> None:
        """The reference made from the report read at `t_read_ns` was in the port's hands at `t_written_ns`."""
        self.wire.add(t_written_ns - t_read_ns)

    def paused(self, span_ns: int) -> None:
        """A garbage collection held everything for so long."""
        self.pause.add(span_ns)
        self.pauses += span_ns > PAUSE_NS
