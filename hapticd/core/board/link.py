"""The link to the board: its clock against the host's, how long a frame takes to get there, and the references that are
on their way.

The board's counter is a slope near 1 and an offset, seen through delays that can only be late. The board answers, so
the exchanges with the shortest round trip are nearest the truth (Cristian 1989; the clock filter of NTP, RFC 5905
section 10). Instants are integer nanoseconds, so nothing depends on the origin; floats only hold differences.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from ...board_protocol import BoardTime
from ...values import Tick

_SENSELESS_NS: Final = 1_000_000_000  # a simulated board that catches up holds a reply for longer than the round trip
_WRAP_US = 2**32  # the board's counter: 71.6 min
MOST_UNREAD: Final = 2  # references; more are only under way at once where a round trip takes longer than two reports
MOST_ON_A_BAD_LINE: Final = 4  # an acknowledgement may be lost there, and the board's dead-man timeout is 50 ms
BAD_FOR_NS: Final = 1_000_000_000  # since the last known loss
FORGOTTEN_NS: Final = 1_000_000_000  # a reference in flight: it was lost, or replaced by the next
QUESTION_EVERY_NS: Final = 4_000_000
QUESTIONS: Final = 12  # at that rate; by then the board's dead-man has tripped
PATIENT_QUESTION_EVERY_NS: Final = 100_000_000


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
    rebooted: the clock locks to it.
    """

    _WINDOW = 64
    _BEST_SHARE = 4  # one in four
    _ENOUGH = 4  # exchanges before the clock counts as known
    _MAX_RTT_NS = 1_000_000_000
    _MAX_RATE = 200e-6  # crystals and their temperature: 100 ppm, doubled
    _MIN_SPAN_NS = 2_000_000_000  # a rate from less is noise
    _CONTRADICTION_NS = 1_000_000  # beyond half the round trip and the drift
    _MOST_PENDING = 16

    def __init__(self) -> None:
        self.relocks = 0
        self.is_asked = False  # a reply is under way, whose instant counts
        self.senseless = 0  # replies in a row whose own times contradict the round trip
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
        self.is_asked = True
        return t_host_ns

    def update(self, reply: BoardTime, t_host_received_ns: int) -> bool:
        """Take the board's answer; False where it is ignored: an unknown stamp, one of the future, too long ago."""
        exchange = self._exchange(reply, t_host_received_ns)
        if exchange is None:
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
        """Reset: the board was replaced; drop its clock and the pending requests."""
        self.senseless = 0
        self.is_asked = False
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
            self.is_asked = False
        held_us = (reply.t_sent_us - reply.t_received_us) % _WRAP_US
        rtt_ns = t_received_ns - sent_ns - held_us * 1000
        self.senseless = self.senseless + 1 if rtt_ns < -_SENSELESS_NS else 0
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
    return sum([value * weight for value, weight in zip(values, weights, strict=True)], 0.0) / sum(weights, 0.0)


class LinkLatency:
    """Latency of a frame from the beginning of its pass to the board's receipt: the 90 % quantile of the last 64.

    Computing is in it as well as the link: it is their part of the horizon, so frames should rarely come later.
    `start_ns` holds until eight frames were measured.
    """

    _WINDOW = 64
    _HIGH = 0.9
    _ENOUGH = 8
    _MAX_NS = 1_000_000_000  # beyond, the stamps belong to another frame

    def __init__(self, start_ns: int = 5_000_000) -> None:
        self.link_ns = start_ns  # the one-way delay to plan with
        self._start_ns = start_ns
        self._delays: deque[int] = deque(maxlen=self._WINDOW)

    def update(self, link_ns: int) -> None:
        """Take one frame's delay; a little below 0 is the clocks' error and counts as 0."""
        if not -self._MAX_NS <= link_ns <= self._MAX_NS:
            return
        self._delays.append(max(link_ns, 0))
        if len(self._delays) >= self._ENOUGH:
            self.link_ns = sorted(self._delays)[int(self._HIGH * (len(self._delays) - 1))]

    def reset(self) -> None:
        """Another link: back to the start value."""
        self._delays.clear()
        self.link_ns = self._start_ns


class Flight(NamedTuple):
    """A reference under way: when it was sent, when it takes effect, and its pass."""

    t_sent_ns: int
    t_apply_ns: int
    tick: Tick


class SendWindow:
    """The references under way: those that the board may not have read yet, oldest first, those that it has not applied
    yet, and the requests sent after them.

    A terminal buffers thousands of bytes for a board that has stopped reading. The board acknowledges each reference
    that took effect, so one that is not acknowledged after a round trip was lost or is still unread. A time request
    decides: the line keeps the order, so a board that answers it has read everything before it.
    """

    def __init__(self) -> None:
        self.unanswered = 0  # references that were never acknowledged as applied: lost, or replaced by the next
        self._unread: deque[tuple[int, int]] = deque()
        self._flights: dict[int, Flight] = {}
        self._questions = 0
        self._t_question_ns = 0
        self._t_lost_ns = -BAD_FOR_NS

    def clear(self) -> None:
        """Reset: the board was reset or replaced."""
        self._unread.clear()
        self._flights.clear()
        self._questions = 0

    def wrote(self, seq: int, t_now_ns: int) -> None:
        """Take note that reference `seq` was sent."""
        self._unread.append((seq, t_now_ns))

    def follow(self, seq: int, flight: Flight) -> None:
        """Follow this reference until it is applied."""
        for oldest, before in list(self._flights.items()):
            if flight.t_sent_ns - before.t_sent_ns <= FORGOTTEN_NS:
                break
            del self._flights[oldest]
            self.unanswered += 1
        self._flights[seq] = flight

    def applied(self, seq: int) -> Flight | None:
        """Return the reference that the board applied, once; None for one that is not followed."""
        return self._flights.pop(seq, None)

    def named(self, seq: int) -> None:
        """Take note that the board has this reference, and so has read all before it."""
        if any(seq == unread for unread, _ in self._unread):
            while self._unread.popleft()[0] != seq:
                pass

    def read_until(self, t_ns: int, t_now_ns: int) -> None:
        """Take note that the board has read all that was sent until `t_ns`. Frames missing from the acknowledgement
        were lost."""
        while self._unread and self._unread[0][1] <= t_ns:
            self._unread.popleft()
            self._t_lost_ns = t_now_ns

    def answered(self) -> None:
        """Take note that the board answered: requests start again at the fast rate."""
        self._questions = 0

    def is_overdue(self, t_now_ns: int, patience_ns: int) -> bool:
        """Whether the oldest was sent longer than `patience_ns` ago."""
        return len(self._unread) > 0 and t_now_ns - self._unread[0][1] > patience_ns

    def is_full(self, t_now_ns: int, patience_ns: int) -> bool:
        """Whether another reference would only be queued."""
        most = MOST_ON_A_BAD_LINE if t_now_ns - self._t_lost_ns < BAD_FOR_NS else MOST_UNREAD
        return len(self._unread) >= most and self.is_overdue(t_now_ns, patience_ns)

    def may_ask(self, t_now_ns: int) -> bool:
        """Return whether a request is due; it then counts as sent."""
        every_ns = QUESTION_EVERY_NS if self._questions < QUESTIONS else PATIENT_QUESTION_EVERY_NS
        if self._questions > 0 and t_now_ns - self._t_question_ns < every_ns:
            return False
        self._questions += 1
        self._t_question_ns = t_now_ns
        return True
