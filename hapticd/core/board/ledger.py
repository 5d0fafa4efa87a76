"""Latency ledger: the last reference frames line by line, and histograms of all."""

from __future__ import annotations

from collections import deque
from typing import Final

from ...board_values import BoardStatus
from ...values import LedgerLine
from .link import BoardClock, Flight, LinkLatency

LEDGER_LENGTH: Final = 512
LATE_NS: Final = 1_000_000  # a frame that takes effect later than planned by more than the clocks' error
_SUB_BITS: Final = 4  # sixteen buckets an octave: a bucket's middle is within 3.2 % of what fell into it
_LONGEST_NS: Final = (1 << 40) - 1  # 18 minutes: all that is longer is one bucket
_FULL: Final = 1 << _SUB_BITS
_BUCKETS: Final = ((40 - _SUB_BITS) << _SUB_BITS) + _FULL


class Histogram:
    """Spans of time in buckets whose width is a sixteenth of their octave; below 32 ns each has its own. A value
    costs one shift and one addition, and the memory does not grow."""

    def __init__(self) -> None:
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
