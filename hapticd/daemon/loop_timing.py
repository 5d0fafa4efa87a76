"""Counters and histograms of the event loop that carries the touch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from ..core.board.ledger import Histogram

PAUSE_NS: Final = 1_000_000  # of Python's collector: longer ones are counted


@dataclass(slots=True)
class LoopTiming:
    """Histograms of the parts of a report's way, and counters of what was late.

    `read_age` is a report's age when it was read, known only while a finger is down; `wait` from its reading to its
    pass; `compute` the pass with all that follows it; `wire` from reading to the written frame. `joined_reports` came
    to a pass together with a newer one; `missed_ticks` of the timer were due while the loop was busy, and are skipped,
    not made up for; `pauses` are those of Python's collector above PAUSE_NS; `overruns` are passes of more than
    `OVERRUN_NS` of the processor, `throttled` the sleeps of a loop that was too busy.
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
