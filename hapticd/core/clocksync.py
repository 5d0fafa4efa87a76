"""Three clocks on one axis: the trackpad's stamps and the board's counter, in host nanoseconds.

Each clock is a slope near 1 and an offset, seen through delays that can only be late. What arrives least late is
nearest the truth: for the trackpad, whose delays cannot be measured, a low quantile of (arrival - stamp); for the
board, which answers, the exchanges with the shortest round trip (Cristian 1989; the clock filter of NTP, RFC 5905
section 10). Instants are integer nanoseconds, so nothing depends on the origin; floats only hold differences.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from ..values import BoardTime
from .prediction_clock import SampleClock

_WRAP_US = 2**32  # the board's counter: 71.6 min


class RollingQuantile:
    """The `share` quantile (lower) of the last `size` values."""

    def __init__(self, size: int, share: float) -> None:
        self._size = size
        self._share = share
        self._arrived: deque[int] = deque()
        self._sorted: list[int] = []

    def __len__(self) -> int:
        return len(self._arrived)

    def push(self, value: int) -> None:
        """Take a value; the oldest goes when there are too many."""
        if len(self._arrived) == self._size:
            self.drop_oldest()
        self._arrived.append(value)
        insort(self._sorted, value)

    def drop_oldest(self) -> None:
        """Forget the value that has been there longest."""
        del self._sorted[bisect_left(self._sorted, self._arrived.popleft())]

    def clear(self) -> None:
        """Forget all values."""
        self._arrived.clear()
        self._sorted.clear()

    @property
    def value(self) -> int:
        """The quantile; IndexError while there is no value."""
        return self._sorted[int(self._share * (len(self._sorted) - 1))]


class SensorClock:
    """The trackpad's stamps on the host's axis, less the pad's own latency.

    Report i arrives at t_host = t_device + offset + lateness, and its stamp may itself be off by a millisecond. The
    pad samples regularly, so its stamps are filtered first (`prediction_clock`): then only lateness is left to
    tell from the offset, and a low quantile of (t_host - t_device) does, where the minimum would chase the worst of
    what the filter leaves. A window of 128 reports (1.4 s) follows a drift of 200 ppm 0.15 ms behind.
    """

    _WINDOW = 128
    _LOW = 1 / 16
    _MAX_AGE_NS = 10_000_000_000  # over a pause a drifting clock becomes a stranger
    _MOST_EARLY_NS = 5_000_000  # no jitter makes a report this early: the clock stepped
    _MOST_LATE_NS = 250_000_000  # a stalled host makes reports late, but not this late
    _LATE_IN_A_ROW = 8  # of more than `_MOST_EARLY_NS`: then it is the clock, not the host
    _LONGEST_TRAIN_NS = 60_000_000  # after a longer gap the pad's samples are a new train
    _PERIOD_S, _PERIOD_ERROR_S = 0.01125, 0.001  # of a Magic Trackpad 2; other pads are found within some reports
    _STAMP_ERROR_S = 0.0006  # +-1 ms, uniform

    def __init__(self, latency_ns: int) -> None:
        self.relocks = 0
        self._latency_ns = latency_ns
        self._differences = RollingQuantile(self._WINDOW, self._LOW)
        self._t_arrivals_ns: deque[int] = deque()
        self._t_device_ns = 0
        self._late_in_a_row = 0
        self._samples = SampleClock(self._PERIOD_S, self._PERIOD_ERROR_S, self._STAMP_ERROR_S)

    def update(self, t_device_ns: int, t_host_ns: int) -> int:
        """When the report stamped `t_device_ns`, read at `t_host_ns`, was sampled; never later than it was read.

        A step of the device's clock shows as a stamp that goes back, a report that is early, or lasting lateness;
        the clock is then locked anew, on this report.
        """
        difference_ns = t_host_ns - t_device_ns
        self._forget_old(t_host_ns)
        if len(self._differences) > 0 and self._has_stepped(t_device_ns, difference_ns):
            self.reset()
            self.relocks += 1
        t_filtered_ns = self._filtered_ns(t_device_ns)
        if len(self._differences) == self._WINDOW:
            self._t_arrivals_ns.popleft()
        self._t_arrivals_ns.append(t_host_ns)
        self._differences.push(t_host_ns - t_filtered_ns)
        return min(t_filtered_ns + self.offset_ns, t_host_ns - self._latency_ns)

    @property
    def offset_ns(self) -> int:
        """Sampling instant less stamp; IndexError before the first report."""
        return self._differences.value - self._latency_ns

    def reset(self) -> None:
        """Forget the clock: the next report locks it anew."""
        self._differences.clear()
        self._t_arrivals_ns.clear()
        self._late_in_a_row = 0

    def _filtered_ns(self, t_device_ns: int) -> int:
        """The stamp as a regular sampler would have given it."""
        elapsed_ns = t_device_ns - self._t_device_ns
        if len(self._differences) == 0 or not 0 <= elapsed_ns <= self._LONGEST_TRAIN_NS:
            self._samples.restart()
        elif elapsed_ns > 0:
            self._samples.advance(elapsed_ns * 1e-9)
        self._t_device_ns = t_device_ns
        return t_device_ns - round(self._samples.lag_s * 1e9)

    def _forget_old(self, t_host_ns: int) -> None:
        while self._t_arrivals_ns and not 0 <= t_host_ns - self._t_arrivals_ns[0] <= self._MAX_AGE_NS:
            self._t_arrivals_ns.popleft()
            self._differences.drop_oldest()

    def _has_stepped(self, t_device_ns: int, difference_ns: int) -> bool:
        late_ns = difference_ns - self._differences.value
        is_late = late_ns > self._MOST_EARLY_NS
        self._late_in_a_row = self._late_in_a_row + 1 if is_late else 0
        return (
            t_device_ns < self._t_device_ns - self._MOST_EARLY_NS
            or not -self._MOST_EARLY_NS <= late_ns <= self._MOST_LATE_NS
            or self._late_in_a_row >= self._LATE_IN_A_ROW
        )


class Exchange(NamedTuple):
    """One question and answer: the middle of each side's interval, and the round trip without the board's own time."""

    t_host_ns: int
    t_board_ns: int
    rtt_ns: int


class BoardClock:
    """The board's wrapped microsecond counter against the host's clock.

    Offset and rate come from the quarter of the last 64 exchanges with the shortest round trips. Half a round trip
    bounds the error of an exchange; a link that is slower one way shifts the offset by half the difference, which
    nothing at either end can see. An exchange that contradicts the lock by more than that means the board has
    rebooted: the clock is locked anew on it.
    """

    _WINDOW = 64
    _BEST_SHARE = 4  # one in four
    _ENOUGH = 4  # exchanges before the clock is trusted
    _MAX_RTT_NS = 1_000_000_000
    _MAX_RATE = 200e-6  # crystals and their temperature: 100 ppm, doubled
    _MIN_SPAN_NS = 2_000_000_000  # a rate from less is noise
    _CONTRADICTION_NS = 1_000_000  # beyond half the round trip and the drift
    _MOST_PENDING = 16

    def __init__(self) -> None:
        self.ignored = 0
        self.relocks = 0
        self._pending: deque[int] | None = None
        self._exchanges: deque[Exchange] = deque(maxlen=self._WINDOW)
        self._anchor = Exchange(0, 0, 0)
        self._rate = 0.0  # board seconds per host second, less 1
        self._spread_ns = 0

    def request(self, t_host_ns: int) -> int:
        """Note a stamp that is being sent, and give it back. From the first on, only noted stamps are answered once."""
        if self._pending is None:
            self._pending = deque(maxlen=self._MOST_PENDING)
        self._pending.append(t_host_ns)
        return t_host_ns

    def update(self, reply: BoardTime, t_host_received_ns: int) -> bool:
        """Take the board's answer; False where it is ignored: an unknown stamp, one of the future, too long ago."""
        exchange = self._exchange(reply, t_host_received_ns)
        if exchange is None:
            self.ignored += 1
            return False
        if self._contradicts(exchange):
            self._exchanges.clear()
            self.relocks += 1
        elif self._exchanges:
            exchange = exchange._replace(t_board_ns=self._unwrapped_ns(exchange.t_board_ns, exchange.t_host_ns))
        self._exchanges.append(exchange)
        self._fit()
        return True

    def reset(self) -> None:
        """The board is another: forget its clock and the questions put to it."""
        self._exchanges.clear()
        if self._pending is not None:
            self._pending.clear()

    @property
    def ready(self) -> bool:
        """Enough exchanges to convert instants."""
        return len(self._exchanges) >= self._ENOUGH

    @property
    def rtt_ns(self) -> int:
        """The shortest round trip of the window; 0 before the first."""
        return min((exchange.rtt_ns for exchange in self._exchanges), default=0)

    @property
    def error_ns(self) -> int:
        """Bound on a conversion's error near now: half the shortest round trip, and how the best exchanges scatter."""
        return self.rtt_ns // 2 + self._spread_ns

    @property
    def rate_ppm(self) -> float:
        """By how much the board's clock is faster than the host's."""
        return self._rate * 1e6

    def to_board_us(self, t_host_ns: int) -> int:
        """The board's wrapped counter at a host instant. RuntimeError before the first exchange."""
        return (self._board_ns(t_host_ns) + 500) // 1000 % _WRAP_US

    def to_host_ns(self, t_board_us: int, near: int) -> int:
        """The host instant, of all that show this wrapped count, nearest `near`. RuntimeError before the first
        exchange."""
        board_near_ns = self._board_ns(near)
        ahead_ns = self._unwrapped_ns(t_board_us * 1000, near) - board_near_ns
        return near + ahead_ns - round(ahead_ns * self._rate)

    def _exchange(self, reply: BoardTime, t_received_ns: int) -> Exchange | None:
        sent_ns = reply.t_host_ns
        if self._pending is not None:
            if sent_ns not in self._pending:
                return None
            self._pending.remove(sent_ns)
        held_us = (reply.t_sent_us - reply.t_received_us) % _WRAP_US
        rtt_ns = t_received_ns - sent_ns - held_us * 1000
        if not (0 <= t_received_ns - sent_ns <= self._MAX_RTT_NS and rtt_ns >= 0):
            return None
        middle_ns = reply.t_received_us % _WRAP_US * 1000 + held_us * 500
        return Exchange(sent_ns + (t_received_ns - sent_ns) // 2, middle_ns, rtt_ns)

    def _contradicts(self, exchange: Exchange) -> bool:
        if not self._exchanges:
            return False
        expected_ns = self._board_ns(exchange.t_host_ns)
        off_ns = self._unwrapped_ns(exchange.t_board_ns, exchange.t_host_ns) - expected_ns
        drift_ns = self._MAX_RATE * abs(exchange.t_host_ns - self._anchor.t_host_ns)
        return abs(off_ns) > exchange.rtt_ns // 2 + self.error_ns + drift_ns + self._CONTRADICTION_NS

    def _fit(self) -> None:
        """A line through the best exchanges, in differences from the newest of them.

        Weights fall with the square of the time lost on the way, for that much an exchange may be off.
        """
        count = max(self._ENOUGH, len(self._exchanges) // self._BEST_SHARE)
        best = sorted(self._exchanges, key=lambda exchange: exchange.rtt_ns)[:count]
        anchor = max(best, key=lambda exchange: exchange.t_host_ns)
        grain_ns = 1000 + best[0].rtt_ns / 8
        weights = [1.0 / (grain_ns + exchange.rtt_ns - best[0].rtt_ns) ** 2 for exchange in best]
        times = [exchange.t_host_ns - anchor.t_host_ns for exchange in best]
        offsets = [exchange.t_board_ns - anchor.t_board_ns - dt for exchange, dt in zip(best, times, strict=True)]
        mean_time, mean_offset = _mean(times, weights), _mean(offsets, weights)
        rate = 0.0
        if max(times) - min(times) >= self._MIN_SPAN_NS:
            around = [(t - mean_time, o - mean_offset) for t, o in zip(times, offsets, strict=True)]
            slope = _mean([t * o for t, o in around], weights) / _mean([t * t for t, _ in around], weights)
            rate = min(max(slope, -self._MAX_RATE), self._MAX_RATE)
        at_anchor_ns = mean_offset - rate * mean_time
        errors = [o - at_anchor_ns - rate * t for t, o in zip(times, offsets, strict=True)]
        self._anchor = anchor._replace(t_board_ns=anchor.t_board_ns + round(at_anchor_ns))
        self._rate = rate
        self._spread_ns = round(math.sqrt(_mean([error * error for error in errors], weights)))

    def _board_ns(self, t_host_ns: int) -> int:
        """The board's unwrapped clock at a host instant."""
        if not self._exchanges:
            raise RuntimeError("the board's clock is not known yet; wait until BoardClock.ready.")
        dt_ns = t_host_ns - self._anchor.t_host_ns
        return self._anchor.t_board_ns + dt_ns + round(dt_ns * self._rate)

    def _unwrapped_ns(self, t_board_ns: int, t_host_ns: int) -> int:
        """The instant that shows the same count as `t_board_ns` and lies nearest what is expected at `t_host_ns`."""
        expected_ns = self._board_ns(t_host_ns)
        wrap_ns = _WRAP_US * 1000
        return expected_ns + (t_board_ns - expected_ns + wrap_ns // 2) % wrap_ns - wrap_ns // 2


def _mean(values: Sequence[float], weights: Sequence[float]) -> float:
    return sum([value * weight for value, weight in zip(values, weights, strict=True)]) / sum(weights)


class LinkLatency:
    """How long a frame takes from the host's send to the board's receipt: the 90 % quantile of the last 64.

    It is the link's part of the horizon, so frames should rarely come later. `start_ns` holds until eight frames
    were measured.
    """

    _WINDOW = 64
    _HIGH = 0.9
    _ENOUGH = 8
    _MAX_NS = 1_000_000_000  # beyond, the stamps belong to another frame

    def __init__(self, start_ns: int = 5_000_000) -> None:
        self.ignored = 0
        self._start_ns = start_ns
        self._delays = RollingQuantile(self._WINDOW, self._HIGH)

    def update(self, link_ns: int) -> None:
        """Take one frame's delay; a little below 0 is the clocks' error and counts as 0."""
        if not -self._MAX_NS <= link_ns <= self._MAX_NS:
            self.ignored += 1
            return
        self._delays.push(max(link_ns, 0))

    def reset(self) -> None:
        """Another link: back to the start value."""
        self._delays.clear()

    @property
    def link_ns(self) -> int:
        """What to plan with."""
        return self._delays.value if len(self._delays) >= self._ENOUGH else self._start_ns
