"""When the trackpad sampled: its stamps in host nanoseconds.

The pad's clock is a slope near 1 and an offset, seen through delays that can only be late and cannot be measured.
What arrives least late is nearest the truth: a low quantile of (arrival - stamp). Instants are integer nanoseconds, so
nothing depends on the origin; floats only hold differences.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from ..rolling_quantile import RollingQuantile
from .sample_clock import SampleClock

_WINDOW: Final = 128
_LOW: Final = 1 / 16
_STAMP_SPREAD_NS: Final = 150_000  # from the low quantile to the median of what the filter leaves of jittered stamps
_MOST_SPREAD_NS: Final = 2_000_000  # a wider one comes from a stalled host, not from the stamps
_MAX_AGE_NS: Final = 10_000_000_000  # drift beyond 200 ppm invalidates older offsets
_MOST_EARLY_NS: Final = 5_000_000  # no jitter makes a report this early: the clock stepped
_MOST_LATE_NS: Final = 250_000_000  # a stalled host makes reports late, but not this late
_LATE_IN_A_ROW: Final = 8  # of more than `_MOST_EARLY_NS`: then it is the clock, not the host
_PERIOD_S: Final = 0.01125  # of a Magic Trackpad 2; other pads are found within some reports
_PERIOD_ERROR_S: Final = 0.0007  # 0.001 locked to a wrong period at stamps off by 3 ms; 0.0005 is slow to find 60 Hz
_STAMP_ERROR_S: Final = 0.0006  # +-1 ms, uniform


class SensorClock:
    """The trackpad's stamps on the host's axis, less the pad's own latency.

    Report i arrives at t_host = t_device + offset + lateness, and its stamp may itself be off by a millisecond. The
    pad samples regularly, so its stamps are filtered first (`sample_clock`): then only lateness has to be
    separated from the offset, and a low quantile of (t_host - t_device) does, where the minimum would chase the worst
    of what the filter leaves. A low quantile is itself off: too early by what the filter leaves, too late by an eighth
    of the lateness. How wide the differences spread tells which. A window of 128 reports (1.4 s) follows a drift of 200
    ppm 0.15 ms behind.
    """

    def __init__(self, latency_ns: int) -> None:
        self.relocks = 0
        self.t_filtered_ns = 0  # the newest stamp, its jitter filtered out
        self.latency_ns = latency_ns  # it may change, by little at a time
        self._differences = RollingQuantile(_WINDOW, _LOW)
        self._t_arrivals_ns: deque[int] = deque()
        self._t_device_ns = 0
        self._late_in_a_row = 0
        self._learned = 0  # reports since it was locked
        self._samples = SampleClock(_PERIOD_S, _PERIOD_ERROR_S, _STAMP_ERROR_S)

    @property
    def period_s(self) -> float:
        """The pad's sampling period, as its stamps show it."""
        return self._samples.period_s

    def update(self, t_device_ns: int, t_host_ns: int) -> int:
        """Return when the report stamped `t_device_ns`, read at `t_host_ns`, was sampled; never later than it was read.

        `t_filtered_ns` is that instant on the device's own axis.

        A step of the device's clock shows as a stamp that goes back, a report that is early, or lasting lateness;
        the clock then locks to this report.
        """
        difference_ns = t_host_ns - t_device_ns
        self._forget_old(t_host_ns)
        if len(self._differences) > 0 and self._has_stepped(t_device_ns, difference_ns):
            self.reset()
            self.relocks += 1
        t_filtered_ns = self.t_filtered_ns = self._samples.filtered_ns(t_device_ns)
        self._t_device_ns = t_device_ns
        if len(self._differences) == _WINDOW:
            self._t_arrivals_ns.popleft()
        self._t_arrivals_ns.append(t_host_ns)
        self._differences.push(t_host_ns - t_filtered_ns)
        self._forget_learning()
        return min(t_filtered_ns + self.offset_ns, t_host_ns - self.latency_ns)

    @property
    def offset_ns(self) -> int:
        """Sampling instant less stamp; IndexError before the first report."""
        return self._differences.value + self._correction_ns() - self.latency_ns

    def _correction_ns(self) -> int:
        """From the low quantile to where a report that is not late would be: the median where stamps alone explain the
        spread; an eighth of the spread before the quantile where lateness does (a seventh of it if that is uniform, a
        tenth if exponential); in between the stamps' share falls as its square."""
        spread_ns = min(self._differences.at(0.5) - self._differences.value, _MOST_SPREAD_NS)
        if spread_ns == 0:
            return 0
        explained_ns = min(spread_ns, _STAMP_SPREAD_NS)
        return (9 * explained_ns * explained_ns - spread_ns * spread_ns) // (8 * spread_ns)

    def reset(self) -> None:
        """Reset: the next report gives the offset."""
        self._samples.restart()
        self._differences.clear()
        self._t_arrivals_ns.clear()
        self._late_in_a_row = 0
        self._learned = 0

    def _forget_learning(self) -> None:
        """Keep only the later half of a young window: the filter's first estimates err by a stamp's whole jitter, and
        the early ones would be the low quantile for as long as they stay."""
        self._learned += 1
        if self._learned < 2 * _WINDOW and self._learned % 2 == 0 and len(self._differences) > 1:
            self._t_arrivals_ns.popleft()
            self._differences.drop_oldest()

    def _forget_old(self, t_host_ns: int) -> None:
        while self._t_arrivals_ns and not 0 <= t_host_ns - self._t_arrivals_ns[0] <= _MAX_AGE_NS:
            self._t_arrivals_ns.popleft()
            self._differences.drop_oldest()

    def _has_stepped(self, t_device_ns: int, difference_ns: int) -> bool:
        late_ns = difference_ns - self._differences.value
        is_late = late_ns > _MOST_EARLY_NS
        self._late_in_a_row = self._late_in_a_row + 1 if is_late else 0
        return (
            t_device_ns < self._t_device_ns - _MOST_EARLY_NS
            or not -_MOST_EARLY_NS <= late_ns <= _MOST_LATE_NS
            or self._late_in_a_row >= _LATE_IN_A_ROW
        )
